"""Where worlds come from, what the robot makes of them, and the simulated robot itself."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from common.config.section import Positive, Section
from common.ids import ID_PATTERN


class MapsConfig(Section):
    """Where worlds come from."""

    train: tuple[str, ...] = ("generator:rooms",)
    """Sources of training worlds: folders of maps, map files with a start (`plan.yaml?start=1.5,2`), or
    `generator:NAME[?key=value&...]`; docs/maps.md has them all. Drawn evenly from all."""
    validation: tuple[str, ...] = ("generator:rooms?seed=1000000",)
    """Sources of validation worlds, used by evaluating actors to choose the best checkpoint. Never the bench maps."""
    validation_count: Annotated[int, Field(ge=1, le=10_000)] = 50
    """How many validation worlds one evaluation uses."""
    train_navigation: tuple[str, ...] = ()
    """Sources for the navigation episodes of a run with `both_tasks`, which need targets; `train` when not given."""
    validation_navigation: tuple[str, ...] = ()
    """Likewise for validation; half of `validation_count` comes from either."""
    metres_per_pixel: Positive | None = None
    """Scale of images and of generated worlds; when not given that of their set (`worlds.toml`), else 0.25. ROS maps
    have their own."""


class MappingConfig(Section):
    """Belief, viewpoint graph, utility and beacons: the same in simulation and on the robot."""

    resolution: Positive = 0.25
    """Belief cell, metres."""
    sensor_range: Positive = 20.0
    """Range of the robot's sensor, metres; longer readings count as 'nothing met' at this range."""
    viewpoint_spacing: Positive = 4.0
    """Distance between neighbouring viewpoints of the lattice, metres."""
    robot_radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Radius of the robot, metres: no edge of the viewpoint graph leads through less clearance; 0 for a point."""
    utility_range: Positive | None = None
    """A viewpoint observes frontiers up to this distance, metres; the sensor range when not given."""
    min_utility: Annotated[int, Field(ge=1)] = 2
    """A viewpoint that observes fewer frontiers counts as useless (utility 0), as long as another one is useful."""
    least_utility: Annotated[int, Field(ge=1)] = 2
    """When no viewpoint observes `min_utility` frontiers any more, those that observe so many are useful."""
    beacon_range: Positive = 20.0
    """d_th of Algorithm 1: a beacon covers useful viewpoints up to this distance in line of sight, metres."""

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
    """A family of worlds in a mix, and what is drawn anew for each of its episodes."""

    name: str
    """Its name, for reports. Lower-case letters, digits and dashes."""
    train: tuple[str, ...] = ()
    """Sources of its training worlds; those of `maps` when not given."""
    validation: tuple[str, ...] = ()
    """Likewise of its validation worlds."""
    tasks: tuple[str, ...] = ()
    """Tasks that it serves, where the run has them; all of the run when not given."""
    teacher: Literal["expert", "reference", "policy"] = "expert"
    """Whom imitation follows here: `expert`: who knows the true map; `reference`: the route of a classical planner, for
    worlds where that is the better beginning; `policy`: `learner.initial_policy`, so that what it can is kept."""
    share: Positive = 1.0
    """Its share of all steps, in proportion to the other families'."""
    sensor_range: tuple[Positive, Positive] | None = None
    """Range of the sensor, drawn between two bounds, metres; `mapping.sensor_range` when not given. Utilities and
    beacons keep their share of it."""
    viewpoint_spacing: tuple[Positive, Positive] | None = None
    """Likewise the distance between neighbouring viewpoints, metres."""
    robot_radius: tuple[Annotated[float, Field(ge=0.0)], Annotated[float, Field(ge=0.0)]] | None = None
    """Likewise the radius of the robot, metres."""
    max_steps: Annotated[int, Field(ge=1, le=10_000)] | None = None
    """Each world's own limit of decisions, by its size, and at most this; `task.max_steps` when not given."""
    unseen_area: Annotated[float, Field(ge=0.0)] | None = None
    """As `task.unseen_area`, which holds when this is not given."""

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
    """`pybullet`: a physics world of wall meshes; `grid`: pure 2D ray traversal, needs no PyBullet; or one that an
    installed package adds, or MODULE:CLASS."""
    fidelity: Literal["kinematic", "dynamic"] = "kinematic"
    """PyBullet only. `kinematic`: carried along the segment; `dynamic`: wheels, motors, contacts."""
    rays: Annotated[int, Field(ge=16, le=7200)] = 720
    """Beams per scan over the full circle."""
    sense_every: Positive | None = None
    """Also scan along the way, every so many metres; by default only at waypoints (the paper's protocol)."""
    speed: Positive = 2.0
    """Driving speed, m/s."""
    range_noise: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of the range noise, metres."""
    lidar_rate: Positive = 10.0
    """Scans per simulated second while driving in dynamic fidelity, Hz."""
    lidar_layers: Literal[1, 16] = 1
    """PyBullet only: 1 for a planar lidar, 16 for a 3D lidar whose returns are projected to the plane."""
    wall_height: Positive = 2.0
    """Height of the walls in PyBullet, metres."""
