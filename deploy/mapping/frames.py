"""The frames that headers name: which is the one that the robot plans in, where a sensor sits, and what to refuse."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from typing import Final

from common.geometry import Pose
from deploy.config import SensingConfig
from deploy.network_config import FramesConfig
from deploy.tf.transform import Transform
from deploy.tf.transforms import TransformTree

# A transform between two names of one frame may be off by so much, metres and radians.
_SAME: Final = 0.01


@dataclass(frozen=True, slots=True)
class Place:
    """Where a message's frame is.

    Attributes:
        on_base: where it lies on the robot; None for a frame of the world.
        in_map: where it lies in the map frame; None for a frame of the robot.
    """

    on_base: Transform | None = None
    in_map: Transform | None = None


class Frames:
    """Finds the frames of sensors and poses in the transforms and the configuration; not thread-safe.

    Where poses come by odometry, its frame is the one that the robot plans in, whatever its name.
    """

    def __init__(self, frames: FramesConfig, sensing: SensingConfig, tree: TransformTree) -> None:
        """Look frames up in a tree that somebody else fills."""
        self._tree = tree
        self._map = frames.map
        self._base = frames.base
        self._by_tf = sensing.pose == "tf"
        self._offset_given = "sensor_offset" in sensing.model_fields_set
        self._odometry: str | None = None
        self._child = ""

    def odometry_problem(self, frame: str, child: str) -> str:
        """Say why a pose of the odometry cannot be taken; empty when it can.

        Args:
            frame: in which it is; the first one that was named is the one of all others.
            child: whose it is, likewise.
        """
        frame, child = plain(frame), plain(child)
        if child != "":
            self._child = self._child or child
            if child != self._child:
                return f"the odometry changed from the pose of {self._child!r} to {child!r}: let one node publish it"
        if frame == "":
            return ""
        if self._odometry is None:
            self._odometry = frame
        if frame != self._odometry:
            return (
                f"the odometry changed from the frame {self._odometry!r} to {frame!r}: let one node publish it, or "
                "take poses from TF (sensing.pose=tf)"
            )
        if frame == self._map or not self._tree.knows(frame):
            return ""
        between = self._newest(self._map, frame)
        if between is None or (hypot(*between.translation) < _SAME and abs(between.pose.yaw) < _SAME):
            return ""
        return (
            f"the odometry is in the frame {frame!r}, which according to TF is at {between.pose} in {self._map!r}: "
            f"take poses from TF (sensing.pose=tf), or plan in the odometry's frame (frames.map={frame})"
        )

    def odometry_note(self) -> str:
        """Say what the odometry's frames are taken for, where they are not those of the configuration."""
        frame, child = self._odometry, self._child
        if frame is not None and frame != self._map:
            return (
                f"the odometry is in the frame {frame!r}, which is assumed to be {self._map!r}: set "
                f"frames.map={frame}, so that the bridge's messages use that frame too"
            )
        if child not in {"", self._base} and self._base_in_child() is None:
            return (
                f"the odometry reports the pose of {child!r}, which is assumed to be {self._base!r}: set "
                f"frames.base={child}, or publish the transform between the two"
            )
        return ""

    def base(self, pose: Pose) -> Pose:
        """Return the base's pose, where the odometry tells that of another frame of the robot and TF knows both."""
        by = self._base_in_child()
        return pose if by is None else (Transform.planar(pose.x, pose.y, pose.yaw) @ by).pose

    def world(self, frame: str) -> Transform | None:
        """Return where a frame of the world, such as that of a map, lies in the map frame; None where nothing says."""
        frame = plain(frame)
        if self.fixed(frame):
            return Transform()
        return self._newest(self._map, frame)

    def fixed(self, frame: str) -> bool:
        """Whether a frame is the one that the robot plans in; no name stands for it."""
        return frame in {"", self._map} or (not self._by_tf and frame == self._odometry)

    def find(self, frame: str, time: float) -> Place | None:
        """Return where a sensor's frame, which has a name, is at a time; None where nothing says."""
        if not self.fixed(frame) and self._tree.stays_behind(frame, self._base) is False:
            # Parts of the robot that stand still are published on /tf too, as seldom as somebody likes.
            found = self._tree.lookup(self._base, frame, time, self._tree.hold)
            return None if found is None else Place(on_base=found)
        in_map = self.world(frame)
        return None if in_map is None else Place(in_map=in_map)

    def joint_behind(self, place: Place, frame: str, time: float, *, new: bool) -> tuple[str, float] | None:
        """Return a joint between the base and a sensor that does not tell yet where that was at a time.

        Args:
            place: where the sensor was found.
            frame: of the sensor.
            time: seconds.
            new: one that has told a single transform counts, too.

        Returns:
            Its frames in words and its newest stamp, seconds; None where all is known.
        """
        return None if place.on_base is None else self._tree.joint_behind(self._base, frame, time, new=new)

    def assumed(self, frame: str) -> tuple[bool, str]:
        """Say whether a sensor whose frame TF does not know may be taken to sit at `sensing.sensor_offset`.

        Returns:
            False where that was not given although the robot has TF; and what an operator has to know, empty for
            nothing.
        """
        if frame == "" or self._offset_given:
            return True, ""
        if self._tree.knows(self._base):
            return False, (
                f"TF has no transform from the frame {frame!r} to {self._base!r}: publish its transform on "
                "/tf_static, or set sensing.sensor_offset"
            )
        return True, (
            f"the position of the frame {frame!r} on {self._base!r} is unknown, so the two are assumed to coincide: "
            "publish its transform on /tf_static, or set sensing.sensor_offset"
        )

    def _base_in_child(self) -> Transform | None:
        child = self._child
        if child in {"", self._base} or self._tree.stays_behind(child, self._base) is not False:
            return None
        return self._newest(child, self._base)

    def _newest(self, target: str, source: str) -> Transform | None:
        time = self._tree.newest(target, source)
        return None if time is None else self._tree.lookup(target, source, time, 0.0)


def plain(frame: str) -> str:
    """Return a frame's name without the slash that ROS 1 put before it."""
    return frame.lstrip("/")
