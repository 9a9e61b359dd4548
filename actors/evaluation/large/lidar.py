"""The 3D lidar without Bullet's ray tests: walls are cells of the map, drawn up to one height, on a flat floor."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.simulators.beams import BeamPattern
from actors.simulators.lidar import Lidar
from common.errors import SimulatorError
from common.geometry import Pose, Scan
from common.mapping.raycast import cast_rays

# Walls of the projected scan are moved back by so much, metres. Tilt makes projected ranges wrong by a millimetre or
# two, wall faces are borders of cells, and a wall that is measured too near marks the free cell before it for good.
BEHIND_FACE: Final = 0.003


class GridLidar(Lidar):
    """A lidar that tilts with the robot as `Lidar` does, and measures on the map that the physics world is made of.

    A ray follows its shadow on the floor: it meets the first occupied cell of it, unless it has met the floor or risen
    above the walls before. That is where the triangles of the physics world are, and it takes a fifth of the time.
    """

    def __init__(self, beams: BeamPattern, layers: int, wall_height: float) -> None:
        super().__init__(beams, layers, wall_height)
        self._map: GridMap | None = None

    def enter(self, world: GridMap) -> None:
        """Take over the map of a world; there is no last scan any more."""
        self._map = world
        self._free = np.ascontiguousarray(world.free)
        self.forget()

    def look(self, pose: Pose, height: float) -> Scan:
        """Scan upright from a pose, without a robot; ``height`` of the lidar above the floor, metres."""
        cosine, sine = np.cos(pose.yaw), np.sin(pose.yaw)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        origin = np.array([pose.x, pose.y, height])
        return self._keep(self._cast(origin, rotation), origin, rotation)

    def _measure(
        self, client: int, body: int, link: int, origin: NDArray[np.float64], rotation: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the range of every ray, as `Lidar` does; see there."""
        del client, body, link
        return self._cast(origin, rotation)

    def _project(
        self, ranges: NDArray[np.float64], rotation: NDArray[np.float64], height: float
    ) -> NDArray[np.float64]:
        return super()._project(ranges, rotation, height) + BEHIND_FACE

    def _cast(self, origin: NDArray[np.float64], rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        world = self._map
        if world is None:
            raise SimulatorError("the lidar has no map: call enter(world) first")
        directions = self._directions @ rotation.T
        flat = np.hypot(directions[:, 0], directions[:, 1])
        rising = directions[:, 2]
        angles = np.arctan2(directions[:, 1], directions[:, 0])
        x, y, height = (float(value) for value in origin)
        # Where the ray meets the floor, and where it leaves the height of the walls.
        with np.errstate(divide="ignore"):
            floor = np.where(rising < 0.0, -height / rising, np.inf)
            top = np.where(rising > 0.0, (self._wall_height - height) / rising, np.inf)
        longest = np.minimum(np.minimum(floor, top), self._beams.range_max)
        reach = longest * flat
        walls = np.empty(len(directions))
        for layer in np.split(np.arange(len(directions)), self._layers):
            # Rays of a layer end about equally far away, so none is followed much further than it must be.
            walls[layer] = cast_rays(
                self._free,
                world.resolution,
                *world.origin,
                x,
                y,
                angles[layer],
                float(reach[layer].max()),
            )
        met = np.where(walls <= reach, walls / np.maximum(flat, 1e-9), np.inf)
        met = np.minimum(met, floor)
        return np.where(met < self._beams.range_max, met, np.inf)
