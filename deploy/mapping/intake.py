"""Where sensor messages wait for the pose of their moment; what comes out is seen from a known place."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from deploy.config import DeployConfig
from deploy.mapping.cloud import checked_points, project
from deploy.mapping.log_odds import Beams
from deploy.mapping.pose_buffer import PoseBuffer
from deploy.mapping.transforms import Transform, TransformTree
from deploy.mapping.volume import ExploredVolume
from deploy.safety.stamps import Order, StampOrder

logger = logging.getLogger(__name__)

StampedTransform = tuple[float, str, str, tuple[float, float, float], tuple[float, float, float, float]]

# Messages that may wait for a pose, and beams that may wait for the map: two and five seconds at 10 Hz.
MAX_WAITING: Final = 20
MAX_READY: Final = 50
# A sensor's frame may come on /tf_static so much later than its first message, seconds; messages wait for it.
FRAME_PATIENCE: Final = 1.0
# A stamp that lies so much further back than the newest one means that the clock was set back, seconds.
CLOCK_JUMP: Final = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A point cloud and the place from where it was seen.

    Attributes:
        points: float32, shape (n, 3 or more), metres.
        transform: where their frame lies in the map frame.
        sensor: x, y, z of the lidar in the map frame, metres.
        floor: height of the floor below the robot in the map frame, metres.
    """

    points: NDArray[np.float32]
    transform: Transform
    sensor: tuple[float, float, float]
    floor: float


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    time: float
    data: Scan | NDArray[np.float32]
    frame: str


class Intake:
    """Poses, transforms and sensor messages of the last seconds; not thread-safe.

    A message waits until poses on both sides of its stamp are there, but not longer than `sensing.pose_tolerance`; then
    the nearest pose counts, where it is so near. Messages that find none are dropped and counted.

    Attributes:
        ready: beams and the sensor's pose for the map, oldest first; the caller takes them out.
        cloud: the newest cloud with its place, for the OctoMap; the caller takes it out.
        received: number of scans and clouds that came.
        dropped: how many were dropped, by reason.
        problem: the last reason in words.
        volume: the explored volume.
    """

    def __init__(self, config: DeployConfig) -> None:
        sensing = config.sensing
        self._config = config
        self._sensing = sensing
        self._range_max = min(sensing.range_max or config.mapping.sensor_range, config.mapping.sensor_range)
        self._by_tf = sensing.pose == "tf"
        self._poses = PoseBuffer()
        self._tree = TransformTree()
        self._waiting: deque[_Waiting] = deque()
        self._clock = float("-inf")
        self._first_of_frame: dict[str, float] = {}
        self._orders: dict[str, StampOrder] = {}
        self.received = 0
        self.dropped: Counter[str] = Counter()
        self.problem = ""
        self.forget()

    def forget(self) -> None:
        """Forget what was sensed, but not the poses."""
        self._waiting.clear()
        self.ready: deque[tuple[Beams, Pose]] = deque()
        self.cloud: Cloud | None = None
        self.volume = ExploredVolume()
        self._newest: dict[type, tuple[float, NDArray[np.float64]]] = {}

    @property
    def waiting(self) -> int:
        """Number of messages that wait for a pose."""
        return len(self._waiting)

    @property
    def pose(self) -> Pose | None:
        """Newest pose of the base in the map frame."""
        if not self._by_tf:
            newest = self._poses.newest
            return None if newest is None else newest[1]
        frames = self._config.frames
        time = self._tree.newest(frames.map, frames.base)
        found = None if time is None else self._tree.lookup(frames.map, frames.base, time, 0.0)
        return None if found is None else found.pose

    def add_pose(self, time: float, pose: Pose, floor: float) -> None:
        """Add a pose of the odometry; it is ignored where poses come by TF."""
        if self._by_tf:
            return
        self._ordered("pose", time)
        if self._poses.add(time, pose, floor):
            self._tick(time)
        else:
            self.drop("pose not finite", f"a pose must be finite, got {pose} at {time}: check the localisation")

    def add_transforms(self, transforms: Iterable[StampedTransform], static: bool) -> None:
        """Add transforms; those that are none are left out and counted."""
        for time, parent, child, translation, rotation in transforms:
            try:
                self._tree.add(time, parent, child, translation, rotation, static=static)
            except MappingError as error:
                self.drop("transform refused", str(error))
                continue
            if not static and self._by_tf:
                if self._ordered(f"transform of {child}", time) is Order.SET_BACK:
                    self._tree.add(time, parent, child, translation, rotation)
                self._tick(time)

    def add_scan(self, time: float, scan: Scan, frame: str) -> None:
        """Add a scan."""
        if scan.range_max > 0.0:
            self._enqueue(_Waiting(time, scan, frame))
        else:
            self.received += 1
            self.drop("scan refused", f"a scan needs a range_max above 0, got {scan.range_max}: correct the driver")

    def add_points(self, time: float, points: NDArray[np.float32], frame: str) -> None:
        """Add a point cloud."""
        try:
            self._enqueue(_Waiting(time, checked_points(points), frame))
        except MappingError as error:
            self.received += 1
            self.drop("cloud refused", str(error))

    def warn(self, problem: str) -> None:
        """Keep a problem that drops nothing, and log it when it is new."""
        if problem != self.problem:
            logger.warning("%s", problem)
        self.problem = problem

    def drop(self, reason: str, problem: str) -> None:
        """Count a message that was dropped, and say why in the log when it is the first one for that reason."""
        self.dropped[reason] += 1
        self.problem = problem
        if self.dropped[reason] == 1:
            logger.warning("%s (only the first is reported): %s", reason, problem)

    def resolve(self) -> None:
        """Place the messages whose poses are there."""
        left: deque[_Waiting] = deque()
        for message in self._waiting:
            if self._must_wait(message):
                left.append(message)
                continue
            place = self._place(message)
            if place is None:
                self.drop(
                    "no pose",
                    f"no pose of {self._config.frames.base!r} within {self._sensing.pose_tolerance} s of the stamp "
                    f"{message.time:.3f} s (newest pose: {self._newest_pose_time()}): check that lidar and "
                    "localisation stamp by the same clock",
                )
                continue
            self._take(message, *place)
        self._waiting = left

    def obstacles(self) -> NDArray[np.float64] | None:
        """Return the obstacles of the newest scan and the newest cloud, map frame, shape (n, 2); None before any."""
        self.resolve()
        if not self._newest:
            return None
        return np.concatenate([points for _, points in self._newest.values()])

    def _enqueue(self, message: _Waiting) -> None:
        self.received += 1
        if not np.isfinite(message.time):
            self.drop("stamp not finite", f"a message needs a finite stamp, got {message.time}: correct its publisher")
            return
        kind = "scan" if isinstance(message.data, Scan) else "cloud"
        if self._ordered(f"{kind} in {message.frame!r}", message.time) in {Order.LATE, Order.REPEATED}:
            self.drop(f"{kind} outdated", f"a {kind} came with the stamp {message.time:.3f} s, which is no news")
            return
        self._tick(message.time)
        self._waiting.append(message)
        if len(self._waiting) > MAX_WAITING:
            self._waiting.popleft()
            self.drop("queue full", f"more than {MAX_WAITING} messages wait for a pose: check that poses come")

    def _ordered(self, stream: str, time: float) -> Order:
        """Take in a stamp of a stream; when the clock was set back, forget all that was stamped before."""
        order = self._orders.setdefault(stream, StampOrder()).take(time)
        if order is Order.SET_BACK:
            self.warn(f"a {stream} is stamped {time:.3f} s: the clock was set back, and poses begin anew")
            self._poses.clear()
            self._tree.forget_moving()
            self._waiting.clear()
            self._newest.clear()
            self._first_of_frame.clear()
            # What the other streams say next is right, whether their clocks are the same one or not.
            self._orders = {stream: self._orders[stream]}
            self._clock = time
        return order

    def _tick(self, time: float) -> None:
        self._clock = time if time < self._clock - CLOCK_JUMP else max(self._clock, time)

    def _newest_pose_time(self) -> float | None:
        if self._by_tf:
            return self._tree.newest(self._config.frames.map, self._config.frames.base)
        return None if self._poses.newest is None else self._poses.newest[0]

    def _must_wait(self, message: _Waiting) -> bool:
        newest = self._newest_pose_time()
        if newest is None:
            return True
        age = self._clock - message.time
        if newest < message.time and age <= self._sensing.pose_tolerance:
            return True
        first = self._first_of_frame.setdefault(message.frame, message.time)
        patient = self._by_tf and message.frame != "" and 0.0 <= message.time - first <= FRAME_PATIENCE
        return patient and age <= FRAME_PATIENCE and self._mount(message) is None

    def _mount(self, message: _Waiting) -> Transform | None:
        """Where the sensor sits on the base, by TF."""
        if message.frame in ("", self._config.frames.map):
            return None
        return self._tree.lookup(self._config.frames.base, message.frame, message.time, self._sensing.pose_tolerance)

    def _place(self, message: _Waiting) -> tuple[Transform, Transform, float] | None:
        """Return base in map, sensor in base, and the height of the floor."""
        tolerance, frames = self._sensing.pose_tolerance, self._config.frames
        mount = self._mount(message)
        if self._by_tf:
            base = self._tree.lookup(frames.map, frames.base, message.time, tolerance)
            if base is None:
                return None
            if mount is not None:
                return base, mount, (base @ mount).translation[2] - self._sensing.sensor_height
            floor = base.translation[2]
        else:
            found = self._poses.at(message.time, tolerance)
            if found is None:
                return None
            pose, floor = found
            base = Transform.planar(pose.x, pose.y, pose.yaw, floor)
        height = self._sensing.sensor_height
        if mount is None:
            mount = Transform.planar(*self._sensing.sensor_offset, z=floor + height - base.translation[2])
        elif not self._by_tf:
            # Odometry does not tell how high the base is; the lidar is as high above the floor as is configured.
            base = Transform.planar(pose.x, pose.y, pose.yaw, floor + height - mount.translation[2])
        return base, mount, floor

    def _take(self, message: _Waiting, base: Transform, mount: Transform, floor: float) -> None:
        sensing = self._sensing
        sensor = base @ mount
        if isinstance(message.data, Scan):
            beams, pose = planar_scan(message.data, base, mount, sensing.range_min, self._range_max)
        else:
            transform = Transform() if sensing.points_frame == "map" else sensor
            beams = project(message.data, transform, sensor.translation, floor, sensing, self._range_max)
            pose = Pose(sensor.translation[0], sensor.translation[1])
            self.volume.add(
                message.data,
                transform.matrix(),
                np.array(transform.translation),
                np.array(sensor.translation),
                sensing.range_min,
                self._range_max,
            )
            self.cloud = Cloud(message.data, transform, sensor.translation, floor)
        kind = type(message.data)
        newest = self._newest.get(kind)
        if newest is None or not newest[0] - CLOCK_JUMP <= message.time < newest[0]:
            self._newest[kind] = (message.time, beams.ends(pose))
        if sensing.source == ("scan" if kind is Scan else "points"):
            self.ready.append((beams, pose))
            if len(self.ready) > MAX_READY:
                self.ready.popleft()
                self.drop("map not refreshed", f"more than {MAX_READY} scans wait for the map: refresh it more often")


def planar_scan(
    scan: Scan, base: Transform, mount: Transform, range_min: float, range_max: float
) -> tuple[Beams, Pose]:
    """Return a scan's beams and the planar pose of its sensor, which may hang upside down."""
    pose, place = base.pose, mount.pose
    sine, cosine = np.sin(pose.yaw), np.cos(pose.yaw)
    sensor = Pose(
        float(pose.x + cosine * place.x - sine * place.y),
        float(pose.y + sine * place.x + cosine * place.y),
        pose.yaw + place.yaw,
    )
    beams = Beams.from_scan(scan, range_min, range_max)
    if mount.matrix()[2, 2] < 0.0:
        beams = Beams(beams.ranges, beams.hits, -beams.angle_min, -beams.angle_increment)
    return beams, sensor
