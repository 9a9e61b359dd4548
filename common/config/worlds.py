"""Where worlds come from, what the robot makes of them, and the simulated robot itself."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from common.config.section import Length, Positive, Section
from common.ids import ID_PATTERN


class MapsConfig(Section):
    """Where worlds come from."""

    train: tuple[str, ...] = ("generator:rooms",)
    """Sources of training worlds: folders of maps, map files with a start (`plan.yaml?start=1.5,2`), or
    `generator:NAME[?key=value&...]`; see docs/maps.md. Sources are sampled uniformly."""
    validation: tuple[str, ...] = ("generator:rooms?seed=1000000",)
    """Sources of validation worlds, on which evaluators choose the best checkpoint. Never use benchmark maps here."""
    validation_count: Annotated[int, Field(ge=1, le=10_000)] = 50
    """Validation worlds per evaluation."""
    train_navigation: tuple[str, ...] = ()
    """Training worlds for navigation episodes when `both_tasks` is set; they need targets. Default: `train`."""
    validation_navigation: tuple[str, ...] = ()
    """Validation worlds for navigation when `both_tasks` is set; each task gets half of `validation_count`. Default:
    `validation`."""
    metres_per_pixel: Length | None = None
    """Scale of images and generated worlds. Default: the scale of their set (`worlds.toml`), else 0.25. ROS maps carry
    their own."""


class MappingConfig(Section):
    """Belief, viewpoint graph, utility and beacons: the same in simulation and on the robot."""

    resolution: Length = 0.25
    """Cell size of the belief, metres."""
    sensor_range: Length = 20.0
    """Range of the robot's sensor, metres; a longer reading means free space up to this range."""
    viewpoint_spacing: Length = 4.0
    """Distance between neighbouring viewpoints of the lattice, metres."""
    robot_radius: Annotated[float, Field(ge=0.0, le=1e3)] = 0.0
    """Radius of the robot, metres: edges of the viewpoint graph keep at least this clearance. 0 for a point robot."""
    utility_range: Length | None = None
    """Distance up to which a viewpoint observes frontiers, metres. Default: the sensor range."""
    min_utility: Annotated[int, Field(ge=1)] = 2
    """Viewpoints that observe fewer frontiers have utility 0, as long as any viewpoint observes this many."""
    least_utility: Annotated[int, Field(ge=1)] = 2
    """Replaces `min_utility` once no viewpoint observes `min_utility` frontiers."""
    beacon_range: Length = 20.0
    """d_th of Algorithm 1, metres: a beacon covers the useful viewpoints within this distance in line of sight."""

    @property
    def observable_range(self) -> float:
        """Range within which a viewpoint observes frontiers, metres."""
        return self.sensor_range if self.utility_range is None else self.utility_range

    def with_planning_set_of(self, other: MappingConfig) -> MappingConfig:
        """Return this mapping with the utilities and beacons of another: in its share of the sensor range, and by its
        metres of frontier.
        """
        scale = self.sensor_range / other.sensor_range
        cells = other.resolution / self.resolution
        return self.model_copy(
            update={
                "utility_range": None if other.utility_range is None else scale * other.utility_range,
                "min_utility": max(1, round(cells * other.min_utility)),
                "least_utility": max(1, round(cells * other.least_utility)),
                "beacon_range": scale * other.beacon_range,
            }
        )

    @model_validator(mode="after")
    def _spacing_fits_resolution(self) -> MappingConfig:
        if self.viewpoint_spacing < 2 * self.resolution:
            raise ValueError(
                f"viewpoint_spacing ({self.viewpoint_spacing} m) must be at least two belief cells "
                f"(2 x {self.resolution} m): raise viewpoint_spacing or lower resolution"
            )
        return self


class FamilyConfig(Section):
    """A family of worlds in a training mix, and the parameters that are randomized per episode."""

    name: str
    """Name in reports. Lower-case letters, digits and dashes."""
    train: tuple[str, ...] = ()
    """Sources of training worlds. Default: those of `maps`."""
    validation: tuple[str, ...] = ()
    """Sources of validation worlds. Default: none if `train` is given, else those of `maps`."""
    tasks: tuple[str, ...] = ()
    """Tasks that use this family. Default: all tasks of the run."""
    teacher: Literal["expert", "reference", "policy"] = "expert"
    """Whom imitation follows here. `expert`: the privileged expert, which knows the true map. `reference`: the route of
    a classical planner, for worlds where that is the better start. `policy`: `learner.initial_policy`, to preserve what
    it has learned."""
    share: Positive = 1.0
    """Share of all steps, relative to the other families."""
    sensor_range: tuple[Length, Length] | None = None
    """Sensor range, drawn per episode between two bounds, metres. Default: `mapping.sensor_range`. The ranges of
    utilities and beacons scale with it."""
    viewpoint_spacing: tuple[Length, Length] | None = None
    """Distance between neighbouring viewpoints, drawn per episode between two bounds, metres. Default:
    `mapping.viewpoint_spacing`."""
    robot_radius: tuple[Annotated[float, Field(ge=0.0, le=1e3)], Annotated[float, Field(ge=0.0, le=1e3)]] | None = None
    """Radius of the robot, drawn per episode between two bounds, metres. Default: `mapping.robot_radius`."""
    max_steps: Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Upper bound of the decisions per episode; below it each world's limit follows from its size. Default:
    `task.max_steps` for every world."""
    unseen_area: Annotated[float, Field(ge=0.0)] | None = None
    """Overrides `task.unseen_area` for this family."""

    @field_validator("name")
    @classmethod
    def _name_is_an_id(cls, value: str) -> str:
        if not ID_PATTERN.fullmatch(value):
            raise ValueError("use 1 to 64 lower-case letters, digits and dashes, such as 'office-2'")
        return value

    @field_validator("sensor_range", "viewpoint_spacing", "robot_radius")
    @classmethod
    def _bounds_ascend(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] > value[1]:
            raise ValueError(f"the lower bound comes first: write [{value[1]:g}, {value[0]:g}]")
        return value

    def serves(self, task: str) -> bool:
        """Whether it has episodes of a task."""
        return not self.tasks or task in self.tasks


class SimulatorConfig(Section):
    """The simulated robot and its sensor."""

    name: str = "pybullet"
    """`pybullet`: physics with walls as a mesh. `grid`: 2D ray traversal only, without PyBullet. Or the name of a
    simulator from an installed package, or MODULE:CLASS."""
    fidelity: Literal["kinematic", "dynamic"] = "kinematic"
    """PyBullet only. `kinematic`: the robot is moved along the segment. `dynamic`: wheels, motors and contacts."""
    rays: Annotated[int, Field(ge=16, le=7200)] = 720
    """Beams per scan over the full circle."""
    sense_every: Positive | None = None
    """Distance between scans along the way, metres. Default: scan only at waypoints, as in the paper."""
    speed: Positive = 2.0
    """Driving speed, m/s."""
    range_noise: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of the range noise, metres."""
    lidar_rate: Positive = 10.0
    """Scans per simulated second while driving in dynamic fidelity, Hz."""
    lidar_layers: Literal[1, 16] = 1
    """PyBullet only. 1: a planar lidar. 16: a 3D lidar whose returns are projected onto the plane."""
    wall_height: Positive = 2.0
    """Height of the walls in PyBullet, metres."""
