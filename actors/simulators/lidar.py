"""Lidars in the physics world: one planar layer, or sixteen whose returns are projected to the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.simulators.beams import BeamPattern
from actors.simulators.bullet import pybullet
from actors.simulators.physics_world import FLOOR_GROUP, WALL_GROUP
from common.errors import SimulatorError
from common.geometry import Pose, Scan

LAYERS_FIELD_OF_VIEW = np.radians(30.0)
# Returns of the 3D lidar between this height and the top of the walls count as walls, metres above the floor.
LOWEST_OBSTACLE = 0.15
_SAME_WALL = 0.05
# Bullet's ray test makes a wall face longer by up to 1.6 mm (see wall_mesh.LONGEST_FACE).
_GRAZE = 0.002
# A call with exactly as many rays as PyBullet's limit drops the last one.
_RAYS_PER_CALL = int(pybullet.MAX_RAY_INTERSECTION_BATCH_SIZE) - 1


class Lidar:
    """A lidar on a link of a robot. Its rays start in the link's frame, so it tilts when the robot does.

    With one layer the rays meet walls only; with sixteen (elevations evenly from -15 to +15 degrees) the floor too.
    """

    def __init__(self, beams: BeamPattern, layers: int, wall_height: float) -> None:
        """Prepare the rays once; `sense` only moves them."""
        self._beams = beams
        self._layers = layers
        self._wall_height = wall_height
        half = 0.5 * float(LAYERS_FIELD_OF_VIEW)
        elevations = np.linspace(-half, half, layers) if layers > 1 else np.zeros(1)
        flat = np.cos(elevations)[:, None]
        directions = np.empty((layers, beams.rays, 3))
        directions[:, :, 0] = flat * np.cos(beams.angles)
        directions[:, :, 1] = flat * np.sin(beams.angles)
        directions[:, :, 2] = np.sin(elevations)[:, None]
        self._directions: NDArray[np.float64] = directions.reshape(-1, 3)
        self.set_range(beams.range_max)
        self._mask = WALL_GROUP if layers == 1 else WALL_GROUP | FLOOR_GROUP
        self._cloud: NDArray[np.float64] | None = None
        self._ranges: NDArray[np.float64] | None = None
        self._frame: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def set_range(self, metres: float) -> None:
        """Let the rays reach so far from the next scan on."""
        self._beams.set_range(metres)
        ends = (self._directions * metres).tolist()
        starts = [[0.0, 0.0, 0.0]] * len(ends)
        self._calls = [
            (starts[i : i + _RAYS_PER_CALL], ends[i : i + _RAYS_PER_CALL]) for i in range(0, len(ends), _RAYS_PER_CALL)
        ]
        self.forget()

    def forget(self) -> None:
        """Drop the last scan."""
        self._ranges = None

    def sense(self, client: int, body: int, link: int) -> Scan:
        """Scan from where the link is now."""
        # Without forward kinematics the link, and rays from it, are where they were one control interval ago.
        state = pybullet.getLinkState(body, link, computeForwardKinematics=True, physicsClientId=client)
        rotation = np.array(pybullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
        origin = np.array(state[0])
        return self._keep(self._measure(client, body, link, origin, rotation), origin, rotation)

    def _keep(self, measured: NDArray[np.float64], origin: NDArray[np.float64], rotation: NDArray[np.float64]) -> Scan:
        """Make the last scan of measured ranges; arguments as `_measure` has them."""
        ranges = self._beams.disturb(measured)
        self._ranges, self._frame = ranges, (origin, rotation)
        return self._beams.to_scan(ranges if self._layers == 1 else self._project(ranges, rotation, float(origin[2])))

    def _measure(
        self, client: int, body: int, link: int, origin: NDArray[np.float64], rotation: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the range of every ray, layer by layer, metres, infinite where it met nothing.

        Args:
            client: number of the physics server.
            body: the robot.
            link: of the lidar.
            origin: of the rays, metres, map frame, shape (3,).
            rotation: from the lidar's frame to the map frame, shape (3, 3).
        """
        del origin, rotation
        fractions = np.array(
            [
                hit[2]
                for starts, ends in self._calls
                for hit in pybullet.rayTestBatch(
                    starts,
                    ends,
                    numThreads=1,
                    parentObjectUniqueId=body,
                    parentLinkIndex=link,
                    collisionFilterMask=self._mask,
                    physicsClientId=client,
                )
            ]
        )
        return np.where(fractions < 1.0, fractions * self._beams.range_max, np.inf)

    def point_cloud(self, *, in_sensor: bool = False) -> NDArray[np.float64]:
        """Return the points of the last scan, metres, shape (n, 3); beams without return are left out.

        Args:
            in_sensor: in the lidar's own frame, tilted as it is; in the map frame otherwise.

        Raises:
            SimulatorError: there was no scan since the reset.
        """
        if self._ranges is None or self._frame is None:
            raise SimulatorError("there is no point cloud before the first scan: call scan() first")
        origin, rotation = self._frame
        met = np.isfinite(self._ranges)
        points: NDArray[np.float64] = self._directions[met] * self._ranges[met, None]
        return points if in_sensor else origin + points @ rotation.T

    def _project(
        self, ranges: NDArray[np.float64], rotation: NDArray[np.float64], height: float
    ) -> NDArray[np.float64]:
        """Return the nearest wall of each azimuth, measured along the plane of the floor.

        Where several layers meet that wall, its range is their mean: the small errors of tilt and noise cancel
        instead of pulling the wall nearer.
        """
        rising = self._directions @ rotation[2]
        flat = ranges * np.sqrt(1.0 - rising**2)
        with np.errstate(invalid="ignore"):
            z = height + ranges * rising
        wall = np.isfinite(ranges) & (z >= LOWEST_OBSTACLE) & (z <= self._wall_height + LOWEST_OBSTACLE)
        layers = np.where(wall, flat, np.inf).reshape(self._layers, -1)
        nearest = layers.min(axis=0)
        same = np.isfinite(layers) & (layers <= nearest + _SAME_WALL)
        met = same.any(axis=0)
        total = np.sum(layers, axis=0, where=same)
        return np.where(met, total / np.maximum(same.sum(axis=0), 1), np.inf)


def free_distance(client: int, pose: Pose, length: float, height: float) -> float:
    """Tell how far a point can go from a pose along its yaw before a wall, infinite when not within ``length``.

    Two more rays run beside: where one of the three is free, the way is free. So a segment that touches just the
    corner of a wall is free, as it is for lines of sight in the belief.
    """
    cosine, sine = np.cos(pose.yaw), np.sin(pose.yaw)
    starts = [[pose.x - s * sine, pose.y + s * cosine, height] for s in (0.0, _GRAZE, -_GRAZE)]
    ends = [[x + length * cosine, y + length * sine, z] for x, y, z in starts]
    hits = pybullet.rayTestBatch(starts, ends, numThreads=1, collisionFilterMask=WALL_GROUP, physicsClientId=client)
    return np.inf if any(hit[0] < 0 for hit in hits) else float(hits[0][2]) * length
