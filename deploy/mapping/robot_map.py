"""The robot's map: sensor messages and poses in, the common Mapper out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from deploy.config import DeployConfig

StampedTransform = tuple[float, str, str, tuple[float, float, float], tuple[float, float, float, float]]


@dataclass(frozen=True, slots=True)
class MapStatistics:
    """What became of the sensor messages.

    Attributes:
        received: scans, clouds or grids that came.
        integrated: those that went into the map.
        waiting: those that wait for a pose.
        dropped: how many were dropped, by reason.
        problem: the last thing that went wrong, one line; empty when nothing did.
        free_area: area known to be free before walls are inflated, square metres.
        explored_volume: voxels of 0.5 m with a point in them, cubic metres; 0 without clouds.
    """

    received: int = 0
    integrated: int = 0
    waiting: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    problem: str = ""
    free_area: float = 0.0
    explored_volume: float = 0.0


class RobotMap:
    """What the robot knows, made from what its sensors say; every method may be called from any thread.

    Usage::

        robot_map = RobotMap(config)
        robot_map.add_pose(time, pose)  # from subscriber threads, as messages come
        robot_map.add_scan(time, scan)
        mapper = robot_map.refresh()  # from the decision thread
    """

    def __init__(self, config: DeployConfig, target: tuple[float, float] | None = None) -> None:
        raise NotImplementedError

    def add_pose(self, time: float, pose: Pose, floor: float = 0.0) -> None:
        """Add a pose of the base in the map frame; `floor` is the height of the floor below it, metres."""
        raise NotImplementedError

    def add_transforms(self, transforms: Iterable[StampedTransform], *, static: bool = False) -> None:
        """Add transforms (time, parent, child, (x, y, z), (x, y, z, w)); `static` for those of /tf_static."""
        raise NotImplementedError

    def add_scan(self, time: float, scan: Scan, frame: str = "") -> None:
        """Add a range scan; `frame` is that of its header, looked up by TF when transforms are there."""
        raise NotImplementedError

    def add_points(self, time: float, points: NDArray[np.float32], frame: str = "") -> None:
        """Add a point cloud, float32, shape (n, 3) or (n, 4+), metres, in the frame of `sensing.points_frame`."""
        raise NotImplementedError

    def add_grid(
        self, time: float, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float, float]
    ) -> None:
        """Take the robot's own SLAM map; only the newest one counts."""
        raise NotImplementedError

    def refresh(self) -> Mapper | None:
        """Apply what came and update the Mapper at the newest pose; None while pose or map lack."""
        raise NotImplementedError

    @property
    def pose(self) -> Pose | None:
        """Newest pose of the base in the map frame; None while there is none."""
        raise NotImplementedError

    @property
    def statistics(self) -> MapStatistics:
        """What became of the sensor messages."""
        raise NotImplementedError

    def obstacles_near(self, pose: Pose, radius: float) -> NDArray[np.float64]:
        """Return the obstacles of the newest scan, cloud or grid around a pose, map frame, metres, shape (n, 2)."""
        raise NotImplementedError

    def occupancy(self) -> tuple[NDArray[np.int8], float, tuple[float, float]]:
        """Return the map before walls are inflated: cells (-1, 0, 100), resolution, (x, y) of the lower left corner."""
        raise NotImplementedError

    def set_target(self, target: tuple[float, float] | None) -> None:
        """Set another navigation target, or none, and keep the map."""
        raise NotImplementedError

    def reset(self, target: tuple[float, float] | None = None) -> None:
        """Forget the map, but not the poses; in navigation, set the new target."""
        raise NotImplementedError
