"""The polygon that the robot must not leave, with no part of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

from shapely import LineString, Polygon, prepare
from shapely import Point as ShapelyPoint

from common.errors import ConfigError
from common.geometry import Pose
from deploy.config import DeployConfig, Point
from deploy.fence import comes_near, fence_shapes


class Geofence:
    """A polygon in the map frame, or no fence at all when it has no corners.

    Its edge belongs to it.
    """

    def __init__(self, corners: Sequence[Point], margin: float = 0.0, outline: Sequence[Point] = ()) -> None:
        """Take the polygon, shrunk by a margin for the robot's centre (such as the robot's radius).

        Args:
            corners: (x, y) in the map frame, metres; empty for no fence.
            margin: metres that the robot's centre keeps from the edge.
            outline: corners of the robot in its own frame, metres; empty for a robot that is inside when its centre
                keeps the margin.

        Raises:
            ConfigError: the corners make no polygon, or the margin leaves nothing of it.
        """
        self._outline = tuple(outline)
        self._whole: Polygon | None = None
        self._inner: Polygon | None = None
        if not corners:
            return
        try:
            self._whole, self._inner = fence_shapes(corners, margin)
        except ValueError as error:
            raise ConfigError(f"{error}, got {list(corners)}") from None
        for shape in (self._whole, self._inner):
            prepare(shape)

    @classmethod
    def around_robot(cls, config: DeployConfig) -> Geofence:
        """Return the fence that the robot of a configuration must be inside with all of its footprint.

        Raises:
            ConfigError: as for a new fence.
        """
        driving = config.driving
        # The graph may keep less room than the default radius of a robot that another stack drives.
        radius = min(driving.robot_radius, config.mapping.robot_radius)
        return cls(config.safety.geofence, radius, driving.footprint)

    def contains(self, position: Point) -> bool:
        """Whether a position (x, y) of the robot's centre lies inside, with the margin."""
        return self._inner is None or bool(self._inner.covers(ShapelyPoint(position)))

    def comes_near(self, target: Point, radius: float) -> bool:
        """Whether the robot's centre can come so near to a target, metres, and stay inside with the margin."""
        return self._inner is None or comes_near(self._inner, target, radius)

    def holds(self, pose: Pose) -> bool:
        """Whether the robot lies inside with all of it when it stands at a pose."""
        if self._whole is None or not self._outline:
            return self.contains(pose.position)
        c, s = cos(pose.yaw), sin(pose.yaw)
        outline = [(pose.x + c * x - s * y, pose.y + s * x + c * y) for x, y in self._outline]
        return bool(self._whole.covers(Polygon(outline)))

    def allows(self, start: Point, end: Point) -> bool:
        """Whether the robot's centre may go straight from one position to another: inside, with the margin.

        One that starts in the margin, as robots do that were put or drifted there, may go back in.
        """
        if self._inner is None or self._whole is None:
            return True
        way = LineString([start, end]) if start != end else ShapelyPoint(start)
        if self._inner.covers(way):
            return True
        return not self.contains(start) and self.contains(end) and bool(self._whole.covers(way))
