"""The mapping that a robot brings along: an OccupancyGrid of what its lidar has seen, from the true pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from common.geometry import Pose, Scan
from common.mapping.belief import Belief
from common.mapping.raycast import cast_rays


class RobotSlam:
    """Sees through the robot's eyes but without its errors; its grid grows as those of SLAM packages do."""

    def __init__(self, world: GridMap, resolution: float, sensor_range: float, rays: int) -> None:
        """Begin with nothing known.

        Args:
            world: true map.
            resolution: of the grid, metres.
            sensor_range: metres.
            rays: beams of a turn.
        """
        self._world = world
        self._range = sensor_range
        self._angles = np.linspace(-np.pi, np.pi, rays, endpoint=False)
        self._belief = Belief(resolution, sensor_range)

    def look(self, pose: Pose) -> None:
        """Take in what can be seen from a pose of the map frame."""
        world = self._world
        ranges = cast_rays(
            world.free, world.resolution, *world.origin, pose.x, pose.y, self._angles + pose.yaw, self._range
        )
        step = float(self._angles[1] - self._angles[0])
        self.take(Scan(ranges, float(self._angles[0]), step, self._range), pose)

    def take(self, scan: Scan, pose: Pose) -> None:
        """Take in what the lidar has measured from a pose: what no map has is seen by it alone."""
        self._belief.integrate(scan, pose)

    def grid(self) -> tuple[NDArray[np.int8], float, tuple[float, float]]:
        """Return the cells (-1, 0, 100; row 0 at the bottom), their size (metres) and the lower left corner."""
        return self._belief.cells.copy(), self._belief.resolution, self._belief.origin
