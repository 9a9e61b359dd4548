"""Where the maps of the robot's own SLAM wait until it is known where they lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deploy.mapping.intake import Intake
from deploy.mapping.slam_grid import SlamGrid
from deploy.tf.stamps import Order, StampOrder
from deploy.tf.transform import Transform


class GridIntake:
    """The newest map of a SLAM, and the frame that it is in; not thread-safe.

    Attributes:
        received: number of maps that came.
    """

    def __init__(self, intake: Intake, map_frame: str, *, wanted: bool) -> None:
        """Take nothing yet.

        Args:
            intake: tells where frames lie, and the operator what became of the maps.
            map_frame: name of the map frame.
            wanted: the robot's map is made from these; where it is not, they are dropped.
        """
        self._intake = intake
        self._map_frame = map_frame
        self._wanted = wanted
        self.received = 0
        self._order = StampOrder()
        self._newest: tuple[SlamGrid, str] | None = None
        self._pending: tuple[SlamGrid, str] | None = None

    def add(
        self, time: float, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float, float], frame: str
    ) -> None:
        """Add a map; arguments as for `RobotMap.add_grid`."""
        self.received += 1
        drop = self._intake.messages.drop
        if not self._wanted:
            drop("grid not wanted", "an OccupancyGrid arrived, but sensing.source is not 'grid'")
        elif self._order.take(time) is Order.LATE:
            drop("grid outdated", "an OccupancyGrid arrived after a newer one")
        elif cells.max(initial=-1) == 1:
            drop(
                "grid refused",
                "an OccupancyGrid's cells are percentages, -1 unknown, 0 free to 100 occupied; none of this one "
                "is above 1, so its walls would be free: publish 100 instead of 1",
            )
        else:
            self._newest = self._pending = SlamGrid(cells, resolution, origin), frame

    def take(self) -> SlamGrid | None:
        """Return the map that came, in the map frame; None while there is none, or its frame is not known."""
        if self._pending is None:
            return None
        grid, frame = self._pending
        place = self._intake.world(frame)
        if place is None:
            self._intake.messages.note(
                f"an OccupancyGrid is in the frame {frame!r}, and TF has no transform to {self._map_frame!r} yet: "
                f"publish it, or set frames.map={frame}"
            )
            return None
        self._pending = None
        corner = (place @ Transform.planar(*grid.origin)).pose
        # What is not moved keeps its numbers: cells on the corners of the SLAM's own need no resampling.
        return grid if place == Transform() else replace(grid, origin=(corner.x, corner.y, corner.yaw))

    def again(self) -> None:
        """Let the newest map count once more: one that is latched comes only once."""
        self._pending = self._newest
        self._order = StampOrder()
