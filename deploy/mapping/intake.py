"""Where sensor messages wait for the pose of their moment; what comes out is seen from a known place."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from deploy.config import DrivingConfig, SensingConfig
from deploy.mapping.cloud import checked_points, project
from deploy.mapping.cloud import problem as cloud_problem
from deploy.mapping.frames import Frames, plain
from deploy.mapping.log_odds import Beams
from deploy.mapping.message_log import MessageLog
from deploy.mapping.own_body import OwnBody
from deploy.mapping.placing import NoPlaceError, Placed, Placing
from deploy.mapping.planar_scan import planar_scan
from deploy.mapping.pose_buffer import PoseBuffer
from deploy.mapping.sweep import points_at_rest
from deploy.mapping.volume import ExploredVolume
from deploy.mapping.waiting import Cloud, Waiting
from deploy.network_config import FramesConfig
from deploy.tf.stamps import Order, StampOrder
from deploy.tf.swings import PoseSwings
from deploy.tf.transform import Quaternion, Transform, Vector
from deploy.tf.transforms import TransformTree

StampedTransform = tuple[float, str, str, Vector, Quaternion]

# Messages that may wait for a pose, and beams that may wait for the map: four and five seconds at 10 Hz.
MAX_WAITING: Final = 40
MAX_READY: Final = 50
# A sensor's frame may come on /tf_static so much later than its first message, seconds; messages wait for it.
FRAME_PATIENCE: Final = 2.0
# Frames come from outside: of more different ones than a robot can have none is remembered.
MAX_STREAMS: Final = 1000
# A stamp that lies so much further back than the newest one means that the clock was set back, seconds.
CLOCK_JUMP: Final = 10.0
# Seconds that are the same but for rounding.
_ROUNDING: Final = 1e-6
# What a lidar saw is no obstacle any more when others on its topic have been stamped so much later, seconds.
_SILENT: Final = 2.0


class Intake:
    """Poses, transforms and sensor messages of the last seconds; not thread-safe.

    A message waits until poses on both sides of its stamp are there, but no longer than these could be within twice
    `sensing.pose_tolerance` of each other; then the nearest pose counts, where it is within the tolerance. Messages
    that find none are dropped and counted.

    Attributes:
        ready: beams and the sensor's pose for the map, oldest first; the caller takes them out.
        cloud: the newest cloud with its place, for the OctoMap; the caller takes it out.
        messages: what became of the scans, clouds and transforms that came.
        volume: the explored volume.
        swing: which link to the base two publishers contest, by the transforms that came last; empty without.
    """

    def __init__(self, frames: FramesConfig, sensing: SensingConfig, farthest: float, driving: DrivingConfig) -> None:
        """Take nothing yet.

        Args:
            frames: their names.
            sensing: how messages are read.
            farthest: range of the sensor, metres: what is beyond is not used.
            driving: for the outline of the robot, in which nothing else can be.
        """
        self._names = frames
        self._body = OwnBody(driving)
        self._sensing = sensing
        self._range_max = min(sensing.range_max or farthest, farthest)
        self._by_tf = sensing.pose == "tf"
        self._poses = PoseBuffer()
        self._tree = TransformTree()
        self._frames = Frames(frames, sensing, self._tree)
        self._placing = Placing(frames, sensing, self._tree, self._poses, self._frames)
        self._waiting: deque[Waiting] = deque()
        self._clock = float("-inf")
        self._first_of_frame: dict[str, float] = {}
        self._given_up: set[str] = set()
        self._orders: dict[str, StampOrder] = {}
        self._swings: dict[str, PoseSwings] = {}
        self.swing = ""
        self._connected = False
        self._first_clock = float("inf")
        self.messages = MessageLog()
        self.forget()

    def forget(self) -> None:
        """Forget what was sensed, but not the poses."""
        self._waiting.clear()
        self.ready: deque[tuple[Beams, Pose]] = deque()
        self.cloud: Cloud | None = None
        self.volume = ExploredVolume()
        self._newest: dict[tuple[type, str], tuple[float, NDArray[np.float64]]] = {}

    def part(self) -> None:
        """Forget what was sensed before the pose leapt: nothing may be placed between there and here."""
        newest = self._poses.newest
        self._poses.clear()
        if newest is not None:
            self._poses.add(*newest)
        self._waiting.clear()
        self.ready.clear()
        self._newest.clear()

    @property
    def waiting(self) -> int:
        """Number of messages that wait for a pose."""
        return len(self._waiting)

    @property
    def pose(self) -> Pose | None:
        """Newest pose of the base in the map frame."""
        if not self._by_tf:
            newest = self._poses.newest
            return None if newest is None else self._frames.base(newest[1])
        frames = self._names
        time = self._tree.newest(frames.map, frames.base)
        found = None if time is None else self._tree.lookup(frames.map, frames.base, time, 0.0)
        return None if found is None else found.pose

    @property
    def outdated(self) -> str:
        """Which link of TF is too old to tell a pose, in words; empty where poses come by odometry, or none is."""
        frames = self._names
        time = self._tree.newest(frames.map, frames.base) if self._by_tf else None
        link = "" if time is None else self._tree.outdated(frames.map, frames.base, time)
        if not link:
            return ""
        return (
            f"{link}, but that of {frames.base!r} {time:.3f} s: restart the SLAM or localisation that publishes the "
            "first, or let both stamp by one clock"
        )

    def add_pose(self, time: float, pose: Pose, floor: float, frame: str = "", child: str = "") -> Pose | None:
        """Add a pose of the odometry, with the frames of its message; it is ignored where poses come by TF.

        Returns:
            That of the base, map frame; None when it does not count.
        """
        if self._by_tf:
            return None
        problem = self._frames.odometry_problem(frame, child)
        if problem:
            self.messages.drop("odometry in another frame", problem)
            return None
        self.messages.note(self._frames.odometry_note())
        self._ordered("pose", time)
        if self._poses.add(time, pose, floor):
            self._tick(time)
            return self._frames.base(pose)
        self.messages.drop("pose not finite", f"a pose must be finite, got {pose} at {time}: check the localisation")
        return None

    def add_transforms(self, transforms: Iterable[StampedTransform], static: bool) -> float | None:
        """Add transforms; those that are none are left out and counted.

        Returns:
            The newest stamp of those that move the base, seconds; None without, and where poses come by odometry.
        """
        moved: dict[str, float] = {}
        self.swing = ""
        for moment, parent, child, translation, rotation in transforms:
            try:
                self._tree.add(moment, parent, child, translation, rotation, static=static)
            except MappingError as error:
                self.messages.drop("transform refused", str(error))
                continue
            if not static and self._by_tf:
                if self._ordered(f"transform of {child}", moment) is Order.SET_BACK:
                    self._tree.add(moment, parent, child, translation, rotation)
                self._tick(moment)
                self._look_for_swings(moment, parent, child, translation, rotation)
                moved[plain(child)] = max(moment, moved.get(plain(child), moment))
        self.messages.note(self.swing or self._tree.contested or self._tree.changed)
        if self._by_tf and not self._connected:
            self._connected = self._placing.newest_pose is not None
            if np.isfinite(self._clock):
                self._first_clock = min(self._first_clock, self._clock)
                if not self._connected and self._clock - self._first_clock > FRAME_PATIENCE:
                    self.messages.note(self._no_pose())
        return moved.get(self._tree.carrier(self._names.map, self._names.base) or "")

    def add_scan(self, time: float, scan: Scan, frame: str, sweep: float = 0.0) -> None:
        """Add a scan, whose last beam was sent ``sweep`` seconds after the first."""
        if scan.range_max > 0.0:
            self._enqueue(Waiting(time, scan, plain(frame), sweep=sweep))
        else:
            self.messages.received += 1
            self.messages.drop(
                "scan refused", f"a scan needs a range_max above 0, got {scan.range_max}: correct the driver"
            )

    def add_points(
        self, time: float, points: NDArray[np.float32], frame: str, times: NDArray[np.float64] | None = None
    ) -> None:
        """Add a point cloud, each of whose points may have been measured so many seconds after the stamp."""
        first, last = (0.0, 0.0) if times is None else (float(times.min()), float(times.max()))
        try:
            self._enqueue(Waiting(time, checked_points(points), plain(frame), first, last - first, times))
        except MappingError as error:
            self.messages.received += 1
            self.messages.drop("cloud refused", str(error))

    def world(self, frame: str) -> Transform | None:
        """Return where a frame of the world, such as that of a SLAM's map, lies in the map frame; None if unknown."""
        return self._frames.world(frame)

    def resolve(self) -> None:
        """Place the messages whose poses are there."""
        left: deque[Waiting] = deque()
        for message in self._waiting:
            if self._must_wait(message):
                left.append(message)
                continue
            placed = self._place(message)
            if placed is not None:
                self._take(message, placed)
        self._waiting = left

    def obstacles(self) -> NDArray[np.float64] | None:
        """Return the obstacles of every lidar's newest scan or cloud, map frame, shape (n, 2); None before any."""
        self.resolve()
        if not self._newest:
            return None
        return np.concatenate([points for _, points in self._newest.values()])

    def _enqueue(self, message: Waiting) -> None:
        self.messages.received += 1
        if not np.isfinite(message.time):
            self.messages.drop(
                "stamp not finite", f"a message needs a finite stamp, got {message.time}: correct its publisher"
            )
            return
        kind, stream = message.kind, message.stream
        if stream not in self._orders and len(self._orders) >= MAX_STREAMS:
            self.messages.drop(
                "too many frames", f"messages arrived in {MAX_STREAMS} frames, the last in {message.frame!r}"
            )
            return
        if self._ordered(stream, message.time) in {Order.LATE, Order.REPEATED}:
            self.messages.drop(
                f"{kind} outdated",
                f"a {kind} arrived with the stamp {message.time:.3f} s, which is not newer than the last one",
            )
            return
        self._tick(message.time)
        self._waiting.append(message)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self.messages.drop("queue full", f"more than {MAX_WAITING} messages wait for a pose: {self._no_pose()}")

    def _no_pose(self) -> str:
        """Say what to do where no pose arrives, naming what lacks in TF."""
        names = self._names
        if not self._by_tf or self._placing.newest_pose is not None:
            return "check that poses arrive"
        if self._tree.contested:
            return self._tree.contested
        return (
            f"{self._tree.gap(names.map, names.base)}: start the localisation or SLAM that publishes it, or set "
            "frames.map and frames.base to frames of TF"
        )

    def _ordered(self, stream: str, time: float) -> Order:
        """Take in a stamp of a stream; when the clock was set back, forget all that was stamped before."""
        order = self._orders.setdefault(stream, StampOrder()).take(time)
        if order is Order.SET_BACK:
            self.messages.warn(
                f"a {stream} is stamped {time:.3f} s: the clock was set back, so earlier poses are discarded"
            )
            self._poses.clear()
            self._tree.forget_moving()
            self._waiting.clear()
            self._newest.clear()
            self._first_of_frame.clear()
            self._swings.clear()
            # What the other streams say next is right, whether their clocks are the same one or not.
            self._orders = {stream: self._orders[stream]}
            self._clock = time
        return order

    def _tick(self, time: float) -> None:
        self._clock = time if time < self._clock - CLOCK_JUMP else max(self._clock, time)

    def _look_for_swings(self, time: float, parent: str, child: str, translation: Vector, rotation: Quaternion) -> None:
        """Note where a link that carries the base swings between what two publishers say of it."""
        child = plain(child)
        if self._tree.carries(self._names.map, self._names.base, child):
            swings = self._swings.setdefault(child, PoseSwings(f"transform {plain(parent)} -> {child}"))
            self.swing = swings.take(time, Transform.checked(translation, rotation).pose) or self.swing

    def _must_wait(self, message: Waiting) -> bool:
        newest = self._placing.newest_pose
        if newest is None:
            return True
        # By the stamps of its own lidar: others, as those of a map -> odom that is stamped ahead, tell nothing of it.
        order = self._orders.get(message.stream)
        latest = message.time if order is None or order.newest is None else order.newest
        tolerance, end = self._sensing.pose_tolerance, message.end
        # A pose may still come that is near enough to the last one to interpolate between the two.
        if newest < end and latest + end - message.time - max(newest, end - tolerance) < 2.0 * tolerance - _ROUNDING:
            return True
        age = max(latest, newest if np.isfinite(newest) else latest) - message.time
        if message.frame in self._given_up or message.frame == "":
            return False
        place = self._frames.find(message.frame, message.time)
        if place is not None:
            late = self._frames.joint_behind(place, message.frame, message.time, new=True)
            return late is not None and age <= 2.0 * tolerance
        first = self._first_of_frame.setdefault(message.frame, message.time)
        if 0.0 <= message.time - first <= FRAME_PATIENCE and age <= FRAME_PATIENCE:
            return True
        self._given_up.add(message.frame)
        return False

    def _place(self, message: Waiting) -> list[Placed] | None:
        """Find out where a message was made, at moments of its sweep; one of which that is not known is dropped."""
        is_scan = isinstance(message.data, Scan)
        try:
            placed = [self._placing.place(moment, message.frame, is_scan=is_scan) for moment in message.moments]
        except NoPlaceError as error:
            self.messages.drop(error.reason, str(error))
            return None
        self.messages.note(placed[0].note)
        return placed

    def _take(self, message: Waiting, places: list[Placed]) -> None:
        sensing, placed = self._sensing, places[len(places) // 2]
        transform, sensor = placed.data, placed.base @ placed.mount
        if isinstance(message.data, Scan):
            both = [(place.base, place.mount) for place in places]
            beams, pose = planar_scan(message.data, both, sensing.range_min, self._range_max, self._body)
        else:
            points = message.data
            if message.times is not None:
                points = points_at_rest(points, message.times, [place.data for place in places])
            reason, problem = cloud_problem(points, transform, sensor.translation, placed.floor, sensing.height_max)
            if reason:
                self.messages.drop(reason, problem)
                return
            beams = project(
                points,
                transform,
                sensor.translation,
                placed.floor,
                sensing,
                self._range_max,
                self._body,
                placed.base.pose,
            )
            pose = Pose(sensor.translation[0], sensor.translation[1])
            self.volume.add(
                points,
                transform.matrix(),
                np.array(transform.translation),
                np.array(sensor.translation),
                sensing.range_min,
                self._range_max,
            )
            if sensing.octomap:
                own = self._body.covers((placed.base.inverse() @ transform).apply(points.astype(np.float64)))
                points = points[~own]
            self.cloud = Cloud(points, transform, sensor.translation, placed.floor)
        kind = type(message.data)
        self._note_obstacles((kind, message.frame), message.time, beams.ends(pose))
        if sensing.source == ("scan" if kind is Scan else "points"):
            self.ready.append((beams, pose))
            if len(self.ready) > MAX_READY:
                self.ready.popleft()
                self.messages.drop(
                    "map not refreshed", f"more than {MAX_READY} scans wait for the map: refresh it more often"
                )

    def _note_obstacles(self, lidar: tuple[type, str], time: float, points: NDArray[np.float64]) -> None:
        """Keep what a lidar saw last; several share a topic, each with its own frame."""
        newest = self._newest.get(lidar)
        if newest is not None and newest[0] - CLOCK_JUMP <= time < newest[0]:
            return
        self._newest = {
            other: seen
            for other, seen in self._newest.items()
            if other[0] is not lidar[0] or abs(time - seen[0]) <= _SILENT
        }
        self._newest[lidar] = (time, points)
