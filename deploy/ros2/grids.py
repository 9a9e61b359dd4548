"""OccupancyGrid messages to cells, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message, stamp
from deploy.ros2.poses import Position, pose_message, pose_of

MAX_CELLS = 1 << 26
"""Larger occupancy grids are refused."""
RESOLUTIONS = (1e-3, 1e2)
"""Smallest and largest cell of an occupancy grid, metres."""


def grid_from(grid: Message) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
    """Return the cells (rows, columns) of an OccupancyGrid, metres per cell, and x, y, yaw of cell (0, 0)'s corner.

    The origin's rotation may be left out (0, 0, 0, 0): then the map is not turned, as for RViz and nav2.

    Raises:
        RosError: when the size does not fit the cells, the resolution is not positive, or the origin is no pose.
    """
    info = grid.info
    if not RESOLUTIONS[0] <= info.resolution <= RESOLUTIONS[1]:
        raise RosError(
            f"an OccupancyGrid's resolution must be positive, {RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g} metres, got "
            f"{info.resolution}"
        )
    if info.width * info.height != len(grid.data) or len(grid.data) > MAX_CELLS:
        raise RosError(
            f"an OccupancyGrid of {info.width} x {info.height} cells (at most {MAX_CELLS}) has {len(grid.data)} cells"
        )
    corner = pose_of(info.origin, may_be_unset=True)
    cells = np.asarray(grid.data, np.int8).reshape(info.height, info.width)
    return cells, info.resolution, (corner.x, corner.y, corner.yaw)


def occupancy_grid(
    time: float,
    frame: str,
    cells: NDArray[np.int8],
    resolution: float,
    origin: tuple[float, float, float] | Position = (0.0, 0.0, 0.0),
) -> Message:
    """Build an OccupancyGrid.

    Args:
        time: stamp, seconds.
        frame: frame of the map.
        cells: -1 unknown, 0 free to 100 occupied, shape (rows, columns); row 0 is lowest in y.
        resolution: metres per cell.
        origin: x, y in metres and perhaps yaw of the corner of cell (0, 0).
    """
    rows, columns = cells.shape
    return message(
        "nav_msgs/msg/OccupancyGrid",
        header=header(time, frame),
        info=message(
            "nav_msgs/msg/MapMetaData",
            map_load_time=stamp(time),
            resolution=resolution,
            width=columns,
            height=rows,
            origin=pose_message(Pose(*origin)),
        ),
        data=np.ascontiguousarray(cells, np.int8).reshape(-1),
    )
