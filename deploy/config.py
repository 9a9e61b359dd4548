"""The bridge's parameter tree; docs/deploy/parameters.md is made from it, so the text of a field is its reference."""

from __future__ import annotations

import re
from math import pi
from typing import Annotated, Final, Literal

from pydantic import Field, field_validator, model_validator

from common.config import Fraction, MappingConfig, Positive, Section
from common.ids import ID_PATTERN
from deploy.network_config import FramesConfig, RosConfig, TopicsConfig
from deploy.outline import circumscribed_radius, inscribed_radius

# Viewpoints of the shipped policies lie a fifth of the sensor's range apart.
SPACINGS_IN_RANGE: Final = 5.0
DEFAULT_NAME: Final = "robot"
Point = tuple[float, float]
NonNegative = Annotated[float, Field(ge=0.0)]


class SensingConfig(Section):
    """How sensor messages become the belief."""

    source: Literal["scan", "points", "grid"] = "scan"
    """What the belief is made from."""
    pose: Literal["odometry", "tf"] = "odometry"
    """Where poses come from: the odometry's own pose in the map frame, or map -> odom -> base by TF."""
    points_frame: Literal["map", "sensor"] = "map"
    """Frame of the point cloud: registered in the map already, or as the sensor sees it."""
    sensor_height: float = 0.4
    """Height of the lidar above the floor, metres, for clouds in the sensor's frame."""
    pose_height: float = 0.0
    """Height above the floor of what the odometry tells the pose of, metres; 0 for a base on the floor."""
    sensor_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y (metres) and yaw (radians) of the lidar in the base frame, where TF does not tell."""
    height_min: float = 0.15
    """Points below this height above the robot's floor are ground, metres."""
    height_max: float = 1.5
    """Points above this height above the robot's floor are ignored, metres."""
    range_min: NonNegative = 0.3
    """Nearer readings are the robot itself, metres."""
    range_max: Positive | None = None
    """Longer readings count as nothing met, metres; the mapping's sensor range when not given."""
    range_noise: NonNegative = 0.03
    """Standard deviation of the sensor's ranges, metres: a return so near before a cell's border is one of the next."""
    beams: Annotated[int, Field(ge=90, le=7200)] = 720
    """Beams into which a point cloud is projected."""
    probability_hit: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.7
    """Occupancy that a return tells of its cell."""
    probability_miss: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.4
    """Occupancy that a passing beam tells of a cell."""
    probability_limits: tuple[float, float] = (0.12, 0.97)
    """Log-odds are clamped here, so that the map stays able to change."""
    occupied_above: Fraction = 0.65
    """A cell more probable than this is occupied."""
    free_below: Fraction = 0.35
    """A cell less probable than this is free; between the two it keeps what it was, unknown at first."""
    grid_occupied: Annotated[int, Field(ge=1, le=100)] = 65
    """Values of an OccupancyGrid from here on are occupied."""
    grid_free: Annotated[int, Field(ge=0, le=99)] = 25
    """Values of an OccupancyGrid up to here are free; between the two they are unknown."""
    hole_area: NonNegative = 1.0
    """In exploration, an unknown area that known cells enclose and that is no larger counts as an obstacle and not as
    something to explore, square metres; 0 for none."""
    octomap: bool = False
    """Build a 3D OctoMap from point clouds (needs pyoctomap) and project it."""
    octomap_resolution: Positive = 0.2
    """Voxel of the OctoMap, metres."""
    pose_tolerance: Positive = 0.2
    """A scan waits for a pose at most so much later or earlier than its stamp, seconds; else it is dropped."""

    @field_validator("sensor_offset")
    @classmethod
    def _yaw_is_in_radians(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if abs(value[2]) > 2.0 * pi:
            raise ValueError("the third number is a yaw in radians, at most 2 pi: is it in degrees?")
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
                f"({self.free_below}) and the second above occupied_above ({self.occupied_above}): no cell could "
                "become free or occupied otherwise"
            )
        return self


class DecisionConfig(Section):
    """What is decided, by whom and how often."""

    task: str = "exploration"
    """What the robot must do: `exploration`, `navigation`, one that an installed package adds, or MODULE:NAME."""
    planner: str = "hdplanner"
    """Name of the planner (`hd-eval planners`), or MODULE:CLASS of one's own; `hdplanner` is a trained policy."""
    policy: str | None = None
    """Weights of `hdplanner`: a .safetensors file with its card, or an .onnx file, as `hd-learner export` writes them;
    the shipped ones when not given."""
    live_run: str | None = None
    """Take the weights of `hdplanner` live from the learner of this run, and only when it is named here."""
    live_connect: tuple[str, ...] = ()
    """Endpoints of that learner."""
    live_tls: tuple[str, str, str] | None = None
    """Files for that learner's TLS, as `hd-learner certificates` makes them: authority, certificate, key."""
    fallback: str | None = None
    """Planner that takes over when the other fails, loops or makes no progress; that of the task when not given:
    `nearest` for exploration, `astar` for navigation."""
    relief: Positive = 30.0
    """How long the fallback decides then, seconds."""
    rate: Positive = 2.0
    """Decisions per second while the robot stands, and at most between two arrivals, Hz."""
    replan: Literal["seen", "always"] = "seen"
    """When to decide between two arrivals: `seen`, as soon as nothing is left to see from where the robot is going;
    `always`, at the rate: planners then waver between two ways, and explore half as much in the same time."""
    arrival_radius: Positive = 0.5
    """A waypoint counts as reached within this distance, metres."""
    goal_radius: Positive = 0.8
    """The navigation target counts as reached within this distance, metres."""
    goal: Point | None = None
    """Navigation target (x, y) in the map frame, metres, when no topic gives one."""
    goal_reach: Positive = 500.0
    """Targets farther from the robot are refused, metres: planning takes memory with the square of the distance."""
    completion_checks: Annotated[int, Field(ge=1)] = 5
    """The planner must say so many times in a row, on new maps, that nothing is left before the task ends."""
    status_rate: Positive = 2.0
    """Messages of status per second, Hz."""
    markers_rate: NonNegative = 1.0
    """Markers and belief per second, Hz; 0 for none."""
    return_home: bool = False
    """Drive back to where the task began when it is done."""
    autostart: bool = False
    """Start as soon as map and pose are there, without a command."""


class DrivingConfig(Section):
    """The bridge's own local planner, for robots without one."""

    enabled: bool = False
    """Publish velocities; otherwise the robot's own stack drives to the waypoints."""
    message: Literal["Twist", "TwistStamped"] = "Twist"
    """Type on the velocity topic (nav2 up to jazzy: Twist, from kilted: TwistStamped)."""
    rate: Positive = 20.0
    """Control commands per second, Hz."""
    max_speed: Positive = 1.0
    """m/s."""
    max_turn_rate: Positive = 1.5
    """rad/s."""
    max_acceleration: Positive = 1.0
    """m/s2."""
    max_turn_acceleration: Positive = 3.0
    """rad/s2."""
    robot_radius: Positive = 0.25
    """Radius of the robot's circle, metres; with a footprint that of the largest circle within it."""
    footprint: tuple[Point, ...] = ()
    """Corners (x, y) of the robot's outline in its own frame, metres: convex, and around (0, 0). Empty for a circle.
    Velocities are checked with it; the graph keeps room for it in every direction unless `mapping.robot_radius` is
    given."""
    clearance: NonNegative = 0.05
    """Room kept beyond the radius, metres."""
    lookahead: Positive = 0.8
    """Distance of the point that is steered for, metres."""
    costmap_size: Positive = 8.0
    """Side of the local costmap, metres."""
    costmap_resolution: Positive = 0.1
    """Cell of the local costmap, metres."""

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
    """What makes the robot stop."""

    scan_timeout: Positive = 1.0
    """Zero velocity when no scan or cloud came for so long, seconds; maps may come only once."""
    pose_timeout: Positive = 1.0
    """Zero velocity when no pose came for so long, seconds."""
    min_beams: Fraction = 0.1
    """A scan or cloud in which a smaller share of beams or points tells anything is blind: three in a row stop the
    robot."""
    bridge_timeout: Positive = 0.3
    """The watchdog sends zero velocity when the bridge was silent for so long, seconds."""
    zero_for: Positive = 5.0
    """How long the watchdog goes on sending zeros after the bridge has gone, seconds."""
    pose_jump: Positive = 1.0
    """A pose that moves farther than the speed limit allows and this between two messages stops the robot, metres."""
    speed_limit: Positive = 2.0
    """The watchdog never lets more through, m/s."""
    turn_limit: Positive = 3.0
    """The watchdog never lets more through, rad/s."""
    geofence: tuple[Point, ...] = ()
    """Polygon (x, y in the map frame) that the robot must not leave with any part of its footprint; empty for none."""
    joy_deadband: Fraction = 0.1
    """A stick axis moved beyond this takes over."""
    joy_axes: tuple[Annotated[int, Field(ge=0)], ...] = (0, 1, 3, 4)
    """Axes of the joystick that are sticks; empty for all. A game pad's triggers rest at 1 and must not be here."""
    joy_release: Positive = 3.0
    """The bridge goes on this long after the sticks came to rest, seconds."""
    progress_time: Positive = 30.0
    """No new area and no nearer goal for so long counts as no progress, seconds."""
    blacklist_time: Positive = 120.0
    """A place that could not be reached is left alone for so long, seconds."""

    @model_validator(mode="after")
    def _fence_is_polygon(self) -> SafetyConfig:
        if self.geofence and len(self.geofence) < 3:
            raise ValueError(
                f"geofence needs at least 3 corners, got {len(self.geofence)}: add corners or leave it empty"
            )
        return self


class RobotMappingConfig(MappingConfig):
    """Belief, viewpoint graph, utility and beacons of a robot."""

    # Defaults of their own: setting one of the others must leave these as they are.
    resolution: Positive = 0.2
    """Belief cell, metres."""
    viewpoint_spacing: Positive = 4.0
    """Side of the squares that hold viewpoints, metres; a fifth of the sensor range when not given, as in training."""
    robot_radius: NonNegative = 0.3
    """Room that the viewpoint graph keeps for the robot's centre, metres: no edge leads through less clearance;
    that of the robot, or of the circle around its footprint, and `driving.clearance` together when not given. A robot
    that is longer than wide passes narrower doors with a smaller one, down to `driving.robot_radius`."""


class DeployConfig(Section):
    """A whole bridge: for what puts its parts together. A part takes the sections that it reads."""

    name: str = ""
    """Name of the robot: its prefix on the bus for commands (`hd/<name>/control`); letters a-z, digits, dashes. When
    not given it is `ros.namespace`, else `robot`; no two bridges of one network may have the same."""
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
    """The own local planner."""
    safety: SafetyConfig = Field(default_factory=SafetyConfig)
    """What makes the robot stop."""

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
        # Filled in here, and nowhere else, because it follows from two sections.
        object.__setattr__(self, "mapping", mapping.model_copy(update=missing))
        if driving.enabled and self.mapping.robot_radius < driving.robot_radius:
            raise ValueError(
                f"mapping.robot_radius ({self.mapping.robot_radius} m) must not be below driving.robot_radius "
                f"({driving.robot_radius} m), or the graph leads where the robot does not fit: raise it or leave it out"
            )
        return self
