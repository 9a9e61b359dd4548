"""What the decision loop needs of a map."""

from __future__ import annotations

from typing import Protocol

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position
from deploy.mapping.robot_map import MapStatistics


class MapSource(Protocol):
    """What the loop needs of `deploy.mapping.robot_map.RobotMap`."""

    def refresh(self) -> Mapper | None:
        """Apply what came and update the mapper; None while pose or map lack."""
        ...

    @property
    def pose(self) -> Pose | None:
        """Newest pose."""
        ...

    @property
    def statistics(self) -> MapStatistics:
        """What became of the sensor messages."""
        ...

    def set_target(self, target: Position | None) -> None:
        """Set another target and keep the map."""
        ...

    def reset(self, target: Position | None = None) -> None:
        """Forget the map."""
        ...
