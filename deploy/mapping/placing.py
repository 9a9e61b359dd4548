"""Where a sensor message was made: the robot's pose of its moment, and the frame that its header names."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, degrees, pi, remainder
from typing import Final

from common.errors import MappingError
from deploy.config import SensingConfig
from deploy.mapping.frames import Frames, Place
from deploy.mapping.pose_buffer import PoseBuffer
from deploy.network_config import FramesConfig
from deploy.tf.transform import Transform
from deploy.tf.transforms import TransformTree

# A base may lie so high above the floor, metres; beyond that TF and the configured height of the lidar disagree.
_HEIGHT_OFF: Final = 0.4
# The same for its place on the base, metres and radians.
_PLACE_OFF: Final = 0.1
# A scan whose plane is tilted further on the robot shows floor and ceiling, degrees; a little less is worth a word.
_STEEPEST: Final = 30.0
_LEVEL: Final = 5.0


class NoPlaceError(MappingError):
    """Nothing tells where a message was made.

    Attributes:
        reason: the same in a word or two, by which such messages are counted.
    """

    def __init__(self, reason: str, problem: str) -> None:
        super().__init__(problem)
        self.reason = reason


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The place of a message.

    Attributes:
        base: where the base is in the map frame.
        mount: where the sensor sits on the base.
        data: where the frame of the data lies in the map frame; that of a cloud may be another than the sensor's.
        floor: height of the floor below the robot in the map frame, metres.
        note: what an operator has to know about it; empty for nothing.
    """

    base: Transform
    mount: Transform
    data: Transform
    floor: float
    note: str = ""


class Placing:
    """Finds the places of messages by poses, transforms and the configuration; not thread-safe."""

    def __init__(
        self, names: FramesConfig, sensing: SensingConfig, tree: TransformTree, poses: PoseBuffer, frames: Frames
    ) -> None:
        """Look things up in what somebody else fills; ``names`` are those of the frames."""
        self._sensing = sensing
        self._by_tf = sensing.pose == "tf"
        self._map, self._base = names.map, names.base
        self._tree = tree
        self._poses = poses
        self._frames = frames

    @property
    def newest_pose(self) -> float | None:
        """Stamp of the newest pose, seconds; None before the first."""
        if self._by_tf:
            return self._tree.newest(self._map, self._base)
        return None if self._poses.newest is None else self._poses.newest[0]

    def place(self, time: float, frame: str, *, is_scan: bool) -> Placed:
        """Find the place of a message.

        Args:
            time: its stamp, seconds.
            frame: of its header; empty where it names none.
            is_scan: a scan, else a cloud.

        Raises:
            NoPlaceError: its frame or the pose of its moment is not known.
        """
        note = ""
        if frame == "" and not is_scan and self._sensing.points_frame == "map":
            place: Place | None = Place(in_map=Transform())
        else:
            place = None if frame == "" else self._frames.find(frame, time)
        if place is None:
            note = self._assumed(frame, is_scan)
        elif is_scan and place.on_base is None:
            raise NoPlaceError(
                "scan in a frame of the world",
                f"a scan is in the frame {frame!r}, which does not move with {self._base!r}: a scan's frame is that of "
                "its lidar, correct the driver",
            )
        joint = None if place is None else self._frames.joint_behind(place, frame, time, new=False)
        if joint is not None:
            raise NoPlaceError(
                "joint outdated",
                f"the frame {frame!r} moves on {self._base!r}, but the newest transform {joint[0]} is stamped "
                f"{joint[1]:.3f} s, before the message ({time:.3f} s), and no later one came within twice "
                "sensing.pose_tolerance: publish it more often, by the lidar's clock",
            )
        if is_scan and place is not None and place.on_base is not None:
            note = self._tilt_note(frame, place.on_base)
        base, floor = self._base_at(time)
        if base.matrix()[2, 2] < 0.0:
            raise NoPlaceError(
                "base upside down",
                f"according to TF, the z axis of {self._base!r} points down in {self._map!r}, so left and right would "
                "be exchanged: is one of the two NED (z down) instead of ENU (z up)?",
            )
        height = self._sensing.sensor_height
        in_base = frame == self._base
        mount = None if place is None else place.on_base
        if mount is None or in_base:
            # Nothing but the configuration tells how high the lidar is, nor for such a cloud where it is.
            x, y, yaw = (0.0, 0.0, 0.0) if in_base else self._sensing.sensor_offset
            above = Transform.planar(x, y, yaw, floor + height - base.translation[2])
            in_map = None if place is None else place.in_map
            data = in_map if in_map is not None else base if in_base else base @ above
            return Placed(base, above, data, floor, note)
        note = note or self._offset_note(frame, mount) or ("" if is_scan else self._height_note(frame, mount))
        if self._by_tf:
            floor = (base @ mount).translation[2] - height
        else:
            # Odometry does not tell how high the base is; the lidar is as high above the floor as is configured.
            x, y, _ = base.translation
            base = Transform((x, y, floor + height - mount.translation[2]), base.rotation)
        return Placed(base, mount, base @ mount, floor, note)

    def _tilt_note(self, frame: str, mount: Transform) -> str:
        """Return what to say of a scan whose plane is not level on the robot.

        Raises:
            NoPlaceError: it is so steep that its beams do not tell where walls are.
        """
        # Upside down is level, too.
        tilt = degrees(acos(min(abs(float(mount.matrix()[2, 2])), 1.0)))
        what = f"a scan is in the frame {frame!r}, whose plane is tilted by {tilt:.0f} degrees on {self._base!r}"
        if tilt > _STEEPEST:
            raise NoPlaceError(
                "scan not level",
                f"{what}: the x axis of a scan's frame points forwards and its z axis up or down; name the lidar's own "
                "frame and not an optical one, or correct its transform",
            )
        return f"{what}: far beams hit the floor, level the lidar or correct its transform" if tilt > _LEVEL else ""

    def _offset_note(self, frame: str, mount: Transform) -> str:
        """Return what to say where TF and the configuration disagree about the place of a sensor."""
        sensing, by_tf = self._sensing, mount.pose
        x, y, yaw = sensing.sensor_offset
        off = max(by_tf.distance_to((x, y)), abs(remainder(by_tf.yaw - yaw, 2.0 * pi)))
        if "sensor_offset" not in sensing.model_fields_set or off <= _PLACE_OFF:
            return ""
        return (
            f"according to TF, the frame {frame!r} is at ({by_tf.x:.2f}, {by_tf.y:.2f}, {by_tf.yaw:.2f}) on "
            f"{self._base!r}, which takes precedence; sensing.sensor_offset is {sensing.sensor_offset}: correct one, "
            "or leave it out"
        )

    def _height_note(self, frame: str, mount: Transform) -> str:
        """Return what to say where TF and the configuration disagree about the height of a lidar."""
        height = self._sensing.sensor_height
        by_tf = mount.translation[2] + (0.0 if self._by_tf else self._sensing.pose_height)
        if abs(by_tf - height) <= _HEIGHT_OFF:
            return ""
        return (
            f"according to TF, the lidar's frame {frame!r} is {by_tf:.2f} m above {self._base!r}, but "
            f"sensing.sensor_height is {height:g} m above the floor, which takes precedence: correct one, or "
            "obstacles are detected at the wrong height"
        )

    def _assumed(self, frame: str, is_scan: bool) -> str:
        """Return what to say where the configuration alone tells where a sensor sits."""
        if not is_scan and self._sensing.points_frame == "map":
            raise NoPlaceError(
                "frame not known",
                f"a cloud is in the frame {frame!r}, which is not {self._map!r}, and TF has no transform between "
                "them: publish it on /tf_static, or set sensing.points_frame=sensor",
            )
        may, note = self._frames.assumed(frame)
        if not may:
            raise NoPlaceError("frame not known", note)
        return note

    def _base_at(self, time: float) -> tuple[Transform, float]:
        """Return where the base is in the map frame, and the height of the floor below it."""
        tolerance = self._sensing.pose_tolerance
        if self._by_tf:
            base = self._tree.lookup(self._map, self._base, time, tolerance)
            if base is not None:
                return base, base.translation[2]
        else:
            found = self._poses.at(time, tolerance)
            if found is not None:
                floor = found[1]
                pose = self._frames.base(found[0])
                return Transform.planar(pose.x, pose.y, pose.yaw, floor + self._sensing.pose_height), floor
        outdated = self._tree.outdated(self._map, self._base, time) if self._by_tf else ""
        if outdated:
            raise NoPlaceError(
                "no pose",
                f"{outdated}, more than {self._tree.hold:g} s from the stamp {time:.3f} s of a message: check that its "
                "publisher lives and stamps by the lidar's clock; one that never changes belongs on /tf_static",
            )
        raise NoPlaceError(
            "no pose",
            f"no pose of {self._base!r} within {tolerance} s of the stamp {time:.3f} s (newest pose: "
            f"{self.newest_pose}): check that lidar and localisation stamp by the same clock, and that poses come at "
            f"least every {2.0 * tolerance:g} s",
        )
