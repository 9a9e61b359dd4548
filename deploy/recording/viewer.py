"""Shows topics live in Rerun, where `rerun-sdk` is installed (extra `rerun`)."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from common import palette
from common.geometry import Pose
from common.palette import rgb
from common.system.extras import optional
from deploy.ros2 import Message, RosError
from deploy.ros2.conversions import grid_from, path_from, points_from, pose_from, position_from, scan_from
from deploy.ros2.messages import deserialize

_BELIEF = np.array([rgb(each.dark) for each in (palette.UNKNOWN, palette.FREE, palette.OCCUPIED)], np.uint8)
_SCAN, _WAY, _WAYPOINT = (rgb(each.dark) for each in (palette.SCAN, palette.WAY, palette.WAYPOINT))


class Viewer:
    """A window of Rerun: trail, scan, clouds, paths and waypoints in the map frame, grids as pictures of their own.

    Scans are drawn at the newest pose of any odometry. Call `show` from one thread alone.
    """

    def __init__(self, distro: str = "jazzy") -> None:
        """Open the window.

        Raises:
            RecordingError: rerun-sdk is not installed.
        """
        self._rerun = _import_rerun()
        self._distro = distro
        self._pose: Pose | None = None
        self._trail: list[tuple[float, float]] = []
        self._rerun.init("hdplanner", spawn=True)

    def show(self, topic: str, kind: str, payload: bytes, arrival: int) -> None:
        """Show a message; types without a picture are passed over.

        Args:
            topic: absolute name, where it appears in the viewer.
            kind: message type.
            payload: CDR.
            arrival: nanoseconds since 1970.
        """
        try:
            self._rerun.set_time("arrival", timestamp=arrival * 1e-9)
            self._draw(topic, kind, deserialize(payload, kind, self._distro))
        except RosError:
            # The recorder keeps it as it is; there is nothing to draw.
            return

    def _draw(self, topic: str, kind: str, message: Message) -> None:
        rerun = self._rerun
        if kind == "nav_msgs/msg/Odometry":
            self._pose = pose_from(message)[1]
            self._trail.append(self._pose.position)
            rerun.log(topic, rerun.LineStrips2D([self._trail], colors=[_WAY]))
        elif kind == "sensor_msgs/msg/LaserScan" and self._pose is not None:
            scan, pose = scan_from(message), self._pose
            angles = pose.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            met = (scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max)
            ends = np.stack([pose.x + scan.ranges * np.cos(angles), pose.y + scan.ranges * np.sin(angles)], axis=1)
            rerun.log(topic, rerun.Points2D(ends[met], colors=_SCAN, radii=0.05))
        elif kind == "sensor_msgs/msg/PointCloud2":
            rerun.log(topic, rerun.Points3D(points_from(message)[:, :3], radii=0.02))
        elif kind == "geometry_msgs/msg/PointStamped":
            rerun.log(topic, rerun.Points2D([position_from(message)[1]], colors=_WAYPOINT, radii=0.2))
        elif kind == "nav_msgs/msg/Path":
            rerun.log(topic, rerun.LineStrips2D([path_from(message)], colors=[_WAYPOINT]))
        elif kind == "nav_msgs/msg/OccupancyGrid":
            cells = grid_from(message)[0]
            picture = _BELIEF[np.where(cells < 0, 0, np.where(cells >= 50, 2, 1))]
            rerun.log(topic, rerun.Image(picture[::-1], color_model="RGB"))
        elif kind == "std_msgs/msg/String":
            rerun.log(topic, rerun.TextLog(message.data))


def _import_rerun() -> ModuleType:
    with optional("--rerun", "rerun"):
        import rerun

    module: ModuleType = rerun
    return module
