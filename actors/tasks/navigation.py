"""Navigation: arrive at a target whose position is given and whose surroundings are unknown."""

from __future__ import annotations

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import TaskConfig
from common.errors import MapError
from common.geometry import Pose
from common.tasks import NAVIGATION, Task


class NavigationGoal:
    """Complete when the robot stands within ``arrival_radius`` metres of the target, or inside its marker."""

    def __init__(self, config: TaskConfig, task: Task = NAVIGATION) -> None:
        self.task = task
        self.arrival_radius = config.arrival_radius
        self._world: GridMap | None = None

    @property
    def target(self) -> tuple[float, float] | None:
        """Position of the target, metres; None before the first reset."""
        return None if self._world is None else self._world.target

    def reset(self, world: GridMap) -> None:
        """Begin an episode; raise MapError for a world without a target."""
        if world.target is None:
            raise MapError(
                f"map {world.name!r} has no target, so it does not suit navigation: "
                "use navigation maps (a red marker) or a generator, or train exploration"
            )
        self._world = world

    def complete(self, coverage: Coverage, pose: Pose) -> bool:
        """Whether the robot has arrived; what was seen does not matter."""
        del coverage
        if self.progress(pose) <= self.arrival_radius:
            return True
        world = self._world
        if world is None or world.target_region is None or not world.is_free(pose.position):
            return False
        return bool(world.target_region[world.cell(pose.position)])

    def progress(self, pose: Pose) -> float:
        """Straight-line distance to the target, metres."""
        if self.target is None:
            raise MapError("navigation needs a target: call reset(world) first")
        return pose.distance_to(self.target)
