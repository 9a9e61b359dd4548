"""The bridge's parameter tree; docs/deploy/parameters.md is made from it, so the text of a field is its reference."""

from __future__ import annotations

import re
from math import pi
from typing import Annotated, Final, Literal

from pydantic import Field, field_validator, model_validator

from common.config import Fraction, MappingConfig, Positive, Section
from common.config.endpoint import BusEndpoint
from common.ids import ID_PATTERN
from deploy.network_config import FramesConfig, RosConfig, TopicsConfig
from deploy.outline import circumscribed_radius, inscribed_radius

# Viewpoints of the shipped policies lie a fifth of the sensor's range apart.
SPACINGS_IN_RANGE: Final = 5.0
DEFAULT_NAME: Final = "robot"
# Left out, they are something else than set to their defaults: they follow from other parameters, from TF, or from
# ROS_DOMAIN_ID.
_FOLLOWING: Final = (
    "name",
    "ros.domain",
    "mapping.viewpoint_spacing",
    "mapping.robot_radius",
    "sensing.sensor_offset",
    "driving.robot_radius",
)
Point = tuple[float, float]
NonNegative = Annotated[float, Field(ge=0.0)]


class SensingConfig(Section):
    """How sensor messages become the belief."""

    source: Literal["scan", "points", "grid"] = "scan"
    """What the belief is made from."""
    pose: Literal["odometry", "tf"] = "odometry"
    """Where poses come from: the odometry's own pose in the map frame, or map -> odom -> base by TF."""
    points_frame: Literal["map", "sensor"] = "map"
    """Frame of the point cloud: `map` if it is already registered, `sensor` if it is raw."""
    sensor_height: float = 0.4
    """Height of the lidar above the floor, metres; for clouds in the sensor frame."""
    pose_height: float = 0.0
    """Height above the floor of the frame whose pose the odometry reports, metres; 0 for a base on the floor."""
    sensor_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y (metres) and yaw (radians) of the lidar in the base frame, used when TF has no transform for it."""
    height_min: float = 0.15
    """Points lower than this above the robot's floor are ground, metres."""
    height_max: float = 1.5
    """Points higher than this above the robot's floor are ignored, metres."""
    range_min: NonNegative = 0.3
    """Readings closer than this are the robot itself, metres."""
    range_max: Positive | None = None
    """Readings beyond this count as no return, metres. Default: `mapping.sensor_range`."""
    no_return: float | Literal["nan"] | None = None
    """Number by which a LaserScan says that a beam met nothing, where that is neither infinite nor at least its
    range_max: `0.0` for many small lidars, `-1.0`, or `nan`. Such beams are free up to range_max, or the number if it
    lies between; also where the robot's own parts block the lidar's view and a driver gives the same number. Default:
    no such number."""
    range_noise: NonNegative = 0.03
    """Standard deviation of the sensor's ranges, metres: a return this close before a cell border is assigned to the
    next cell."""
    beams: Annotated[int, Field(ge=90, le=7200)] = 720
    """Number of beams into which a point cloud is projected."""
    probability_hit: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.7
    """Occupancy probability of a cell with a return."""
    probability_miss: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.4
    """Occupancy probability of a cell that a beam passes through."""
    probability_limits: tuple[float, float] = (0.12, 0.97)
    """Clamping bounds of the occupancy probability; they keep the map able to change."""
    occupied_above: Fraction = 0.65
    """Cells above this probability are occupied."""
    free_below: Fraction = 0.35
    """Cells below this probability are free; in between a cell keeps its state, which is unknown at first."""
    grid_occupied: Annotated[int, Field(ge=1, le=100)] = 65
    """OccupancyGrid values from this on are occupied."""
    grid_free: Annotated[int, Field(ge=0, le=99)] = 25
    """OccupancyGrid values up to this are free; values in between are unknown."""
    hole_area: NonNegative = 1.0
    """In exploration, unknown areas enclosed by known cells and no larger than this are treated as obstacles instead of
    being explored, m²; 0 disables it."""
    octomap: bool = False
    """Build a 3D OctoMap from point clouds (needs pyoctomap) and project it."""
    octomap_resolution: Positive = 0.2
    """Voxel size of the OctoMap, metres."""
    deskew: bool = True
    """Place each beam by the robot's pose of its own moment (`time_increment` of a LaserScan, a time field of a
    PointCloud2). Set it to false where a node before the bridge does that for clouds and leaves the field in."""
    pose_tolerance: Positive = 0.2
    """Maximum difference between the stamps of a scan and of its pose, seconds; scans without such a pose are
    dropped."""

    @field_validator("sensor_offset")
    @classmethod
    def _yaw_is_in_radians(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if abs(value[2]) > 2.0 * pi:
            raise ValueError("the third number is a yaw in radians, at most 2 pi in magnitude; is it in degrees?")
        return value

    @model_validator(mode="after")
    def _bounds_are_ordered(self) -> SensingConfig:
        for low, high in (
            ("height_min", "height_max"),
            ("free_below", "occupied_above"),
            ("grid_free", "grid_occupied"),
        ):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(
                    f"{low} ({getattr(self, low)}) must be below {high} ({getattr(self, high)}): correct one of the two"
                )
        lowest, highest = self.probability_limits
        if not 0.0 < lowest < self.free_below or not self.occupied_above < highest < 1.0:
            raise ValueError(
                f"probability_limits {self.probability_limits} must lie in (0, 1), the first below free_below "
                f"({self.free_below}) and the second above occupied_above ({self.occupied_above}): otherwise no cell "
                "could become free or occupied"
            )
        return self


class DecisionConfig(Section):
    """What the robot decides, with which planner, and how often."""

    task: str = "exploration"
    """`exploration`, `navigation`, the name of a task from an installed package, or MODULE:NAME."""
    planner: str = "hdplanner"
    """Name of a planner (`hd-eval planners`) or MODULE:CLASS; `hdplanner` is a trained policy."""
    policy: str | None = None
    """Weights of `hdplanner`: a .safetensors file with its card, or an .onnx file, as `hd-learner export` writes them.
    Default: the shipped weights."""
    live_run: str | None = None
    """Follow the weights of this run's learner while it trains. Off by default."""
    live_connect: tuple[BusEndpoint, ...] = ()
    """Endpoints of that learner."""
    live_tls: tuple[str, str, str] | None = None
    """TLS files for that learner, from `hd-learner certificates`: authority, certificate, key."""
    fallback: str | None = None
    """Planner that takes over when the main one fails, loops or makes no progress. Default: `nearest` for exploration,
    `astar` for navigation."""
    relief: Positive = 30.0
    """How long the fallback keeps deciding after it took over, seconds."""
    rate: Positive = 2.0
    """Decisions per second while the robot stands, and the maximum while it drives to a waypoint, Hz."""
    replan: Literal["seen", "always"] = "seen"
    """When to decide again on the way to a waypoint. `seen`: once nothing is left to see from there. `always`: at
    `decision.rate`; planners then tend to oscillate between two routes and explore half as much in the same time."""
    arrival_radius: Positive = 0.5
    """A waypoint counts as reached within this distance, metres."""
    goal_radius: Positive = 0.8
    """The navigation target counts as reached within this distance, metres."""
    goal: Point | None = None
    """Navigation target (x, y) in the map frame, metres; used until a topic or command gives one."""
    goal_reach: Positive = 500.0
    """Maximum distance of a target from the robot, metres; farther ones are rejected, because the planner's memory
    grows with the square of the distance."""
    completion_checks: Annotated[int, Field(ge=1)] = 5
    """The task ends after the planner has reported this many times in a row, each on a new map, that nothing is
    left."""
    status_rate: Positive = 2.0
    """Rate of status messages, Hz."""
    markers_rate: NonNegative = 1.0
    """Rate of markers and belief, Hz; 0 disables them."""
    return_home: bool = False
    """Return to where the task began once it is done."""
    autostart: bool = False
    """Start without a command, as soon as map and pose are available."""

    @model_validator(mode="after")
    def _live_run_has_a_learner(self) -> DecisionConfig:
        if self.live_run is not None and not self.live_connect:
            raise ValueError("decision.live_run needs decision.live_connect: name the learner's endpoint")
        return self


class DrivingConfig(Section):
    """The bridge's local planner, for robots without one."""

    enabled: bool = False
    """Publish velocities; otherwise the robot's own stack drives to the waypoints."""
    message: Literal["Twist", "TwistStamped"] = "Twist"
    """Type on the velocity topic (nav2 up to jazzy: Twist, from kilted: TwistStamped)."""
    rate: Positive = 20.0
    """Rate of velocity commands, Hz."""
    max_speed: Positive = 1.0
    """Maximum speed, m/s."""
    max_turn_rate: Positive = 1.5
    """Maximum turn rate, rad/s."""
    max_acceleration: Positive = 1.0
    """Maximum acceleration, m/s²."""
    max_turn_acceleration: Positive = 3.0
    """Maximum angular acceleration, rad/s²."""
    robot_radius: Positive = 0.25
    """Radius of a circular robot, metres. Default with a footprint: its largest inscribed circle."""
    footprint: tuple[Point, ...] = ()
    """Corners (x, y) of the robot's outline in its base frame, metres: convex and containing (0, 0). Empty for a
    circle. Velocities are checked against it; the graph keeps room for it in every direction unless
    `mapping.robot_radius` is given."""
    clearance: NonNegative = 0.05
    """Margin beyond the radius, metres."""
    lookahead: Positive = 0.8
    """Distance to the point that the robot steers for, metres."""
    costmap_size: Positive = 8.0
    """Side of the local costmap, metres."""
    costmap_resolution: Positive = 0.1
    """Cell size of the local costmap, metres."""

    @model_validator(mode="after")
    def _circle_lies_within_footprint(self) -> DrivingConfig:
        if self.footprint:
            inscribed = inscribed_radius(self.footprint)
            if "robot_radius" not in self.model_fields_set:
                object.__setattr__(self, "robot_radius", inscribed)
            elif self.robot_radius > inscribed + 1e-6:
                raise ValueError(
                    f"robot_radius ({self.robot_radius:g} m) must not exceed the largest circle within the footprint "
                    f"({inscribed:.3f} m): leave it out"
                )
        return self

    @property
    def reach(self) -> float:
        """Radius of the smallest circle that holds the robot, metres."""
        return circumscribed_radius(self.footprint) if self.footprint else self.robot_radius


class SafetyConfig(Section):
    """When the robot stops."""

    scan_timeout: Positive = 1.0
    """Stop when no scan or cloud has arrived for this long, seconds. Occupancy grids are exempt: a SLAM may publish
    only once."""
    pose_timeout: Positive = 1.0
    """Stop when no pose has arrived for this long, seconds."""
    min_beams: Fraction = 0.1
    """A scan or cloud with a smaller share of usable beams or points counts as blind; three in a row stop the robot."""
    bridge_timeout: Positive = 0.3
    """The watchdog sends zero velocity when the bridge has been silent for this long, seconds."""
    zero_for: Positive = 5.0
    """How long the watchdog keeps sending zero velocity after the bridge has gone, seconds."""
    pose_jump: Positive = 1.0
    """Stop when a pose moves farther between two messages than the speed limit allows plus this, metres."""
    speed_limit: Positive = 2.0
    """Upper limit of the speed that the watchdog lets through, m/s."""
    turn_limit: Positive = 3.0
    """Upper limit of the turn rate that the watchdog lets through, rad/s."""
    geofence: tuple[Point, ...] = ()
    """Polygon (x, y in the map frame) that no part of the robot may leave; empty for none."""
    joy_deadband: Fraction = 0.1
    """Moving a stick axis beyond this takes over manual control."""
    joy_axes: tuple[Annotated[int, Field(ge=0)], ...] = (0, 1, 3, 4)
    """Joystick axes that are sticks; empty for all. Leave out a game pad's triggers: they rest at 1."""
    joy_release: Positive = 3.0
    """The bridge resumes this long after the sticks have been released, seconds."""
    progress_time: Positive = 30.0
    """Time without new area or getting closer to the goal that counts as no progress, seconds."""
    blacklist_time: Positive = 120.0
    """How long a place that could not be reached is avoided, seconds."""

    @field_validator("geofence")
    @classmethod
    def _fence_is_polygon(cls, value: tuple[Point, ...]) -> tuple[Point, ...]:
        if value:
            from deploy.fence import fence_shapes

            fence_shapes(value, 0.0)
        return value


class RobotMappingConfig(MappingConfig):
    """Belief, viewpoint graph, utility and beacons of a robot."""

    # Defaults of their own: setting one of the others must leave these as they are.
    resolution: Positive = 0.2
    """Belief cell, metres."""
    viewpoint_spacing: Positive = 4.0
    """Side of the squares that hold viewpoints, metres. Default: a fifth of the sensor range, as in training."""
    robot_radius: NonNegative = 0.3
    """Clearance that the viewpoint graph keeps around the robot's centre, metres. Default: the radius of the robot, or
    of the circle around its footprint, plus `driving.clearance`. For a robot that is longer than wide, a smaller value
    down to `driving.robot_radius` opens narrower doors."""


class DeployConfig(Section):
    """A whole bridge: for what puts its parts together. A part takes the sections that it reads."""

    name: str = ""
    """Name of the robot and prefix of its commands on the bus (`hd/<name>/control`); letters a-z, digits, dashes.
    Default: `ros.namespace`, else `robot`. Unique among the bridges of a network."""
    ros: RosConfig = Field(default_factory=RosConfig)
    """ROS 2 over Zenoh."""
    frames: FramesConfig = Field(default_factory=FramesConfig)
    """Coordinate frames."""
    topics: TopicsConfig = Field(default_factory=TopicsConfig)
    """Topic names."""
    mapping: RobotMappingConfig = Field(default_factory=RobotMappingConfig)
    """Belief, viewpoint graph, utility and beacons."""
    sensing: SensingConfig = Field(default_factory=SensingConfig)
    """How sensor messages become the belief."""
    decision: DecisionConfig = Field(default_factory=DecisionConfig)
    """What is decided."""
    driving: DrivingConfig = Field(default_factory=DrivingConfig)
    """The local planner."""
    safety: SafetyConfig = Field(default_factory=SafetyConfig)
    """When the robot stops."""

    @field_validator("name")
    @classmethod
    def _name_is_an_id(cls, value: str) -> str:
        if not ID_PATTERN.fullmatch(value):
            raise ValueError("use 1 to 64 lower-case letters, digits and dashes, such as 'robot-2'")
        return value

    @property
    def named(self) -> bool:
        """Whether a name was given, by itself or by the namespace."""
        return "name" in self.model_fields_set or bool(self.ros.namespace.strip("/"))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Parameters, as ``section.field``, that nobody set and whose values follow from something else."""

        def given(path: str) -> bool:
            section, _, field = path.rpartition(".")
            return field in (getattr(self, section) if section else self).model_fields_set

        return tuple(path for path in _FOLLOWING if not given(path))

    @model_validator(mode="after")
    def _name_follows_the_namespace(self) -> DeployConfig:
        if "name" not in self.model_fields_set:
            words = re.sub(r"[^a-z0-9-]+", "-", self.ros.namespace.lower()).strip("-")[:64]
            object.__setattr__(self, "name", words or DEFAULT_NAME)
        return self

    @model_validator(mode="after")
    def _graph_suits_the_robot(self) -> DeployConfig:
        mapping, driving = self.mapping, self.driving
        follows = {
            "viewpoint_spacing": max(mapping.sensor_range / SPACINGS_IN_RANGE, 2.0 * mapping.resolution),
            "robot_radius": driving.reach + driving.clearance,
        }
        missing = {name: value for name, value in follows.items() if name not in mapping.model_fields_set}
        # Filled in here, and nowhere else, because it follows from two sections; not as set, see `left_out`.
        filled = mapping.model_copy()
        for name, value in missing.items():
            object.__setattr__(filled, name, value)
        object.__setattr__(self, "mapping", filled)
        if driving.enabled and self.mapping.robot_radius < driving.robot_radius:
            raise ValueError(
                f"mapping.robot_radius ({self.mapping.robot_radius} m) must not be below driving.robot_radius "
                f"({driving.robot_radius} m), or the graph leads where the robot does not fit: raise it or leave it out"
            )
        if self.safety.geofence:
            from deploy.fence import comes_near, fence_shapes

            _, inner = fence_shapes(self.safety.geofence, self.mapping.robot_radius)
            goal, near = self.decision.goal, self.decision.goal_radius
            if goal is not None and not comes_near(inner, goal, near):
                raise ValueError(
                    "decision.goal must lie inside safety.geofence, or within decision.goal_radius "
                    f"({near:g} m) of where the robot may be, got ({goal[0]:g}, {goal[1]:g}): change one"
                )
        return self
