"""Where the robot is, as the watchdog knows it: whether it has left the geofence."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from common.errors import MappingError
from common.geometry import Pose
from deploy.network_config import FramesConfig, TopicsConfig
from deploy.ros2 import SENSOR, STATIC, Message, Node, QoS, Received
from deploy.ros2.conversions import pose_from, transforms_from
from deploy.safety.geofence import Geofence
from deploy.tf.stamps import Order, StampOrder
from deploy.tf.transforms import TransformTree

log = logging.getLogger(__name__)

_TRANSFORMS = QoS(depth=100)


class FenceWatch:
    """Follows the robot by odometry or TF, without the bridge, and tells when it leaves the fence or comes back.

    Usage::

        FenceWatch(fence, topics, frames, lambda outside: print(outside or "inside")).subscribe(node)
    """

    def __init__(
        self,
        fence: Geofence,
        topics: TopicsConfig,
        frames: FramesConfig,
        tell: Callable[[str], None],
        *,
        by_tf: bool = False,
    ) -> None:
        """Know nothing yet.

        Args:
            fence: that the robot must be inside with all of it.
            topics: names of those that tell poses.
            frames: names of the map's and of the robot's.
            tell: called from the threads of subscriptions with where the robot stands outside, empty when it is inside.
            by_tf: poses come by transforms, not by odometry.
        """
        self._fence = fence
        self._by_tf = by_tf
        self._topics = topics
        self._frames = frames
        self._tell = tell
        self._tree = TransformTree()
        self._orders: dict[str, StampOrder] = {}
        self._lock = threading.Lock()
        self._inside = True

    def subscribe(self, node: Node) -> None:
        """Listen to what tells the robot's pose in the map frame."""
        topics = self._topics
        if not self._by_tf:
            node.subscribe(topics.odometry, "nav_msgs/msg/Odometry", self.take_odometry, SENSOR)
            return
        node.subscribe(topics.tf, "tf2_msgs/msg/TFMessage", self.take_transforms, _TRANSFORMS)
        if topics.tf_static:
            node.subscribe(topics.tf_static, "tf2_msgs/msg/TFMessage", self.take_static_transforms, STATIC)

    def take_odometry(self, odometry: Message, received: Received) -> None:
        """Take a nav_msgs/Odometry, whose pose is in the map frame."""
        del received
        stamp, pose, _ = pose_from(odometry)
        with self._lock:
            # One that was overtaken tells where the robot was: that it was inside is no news.
            if self._order("odometry", stamp) is not Order.LATE or not self._fence.holds(pose):
                self._at(pose)

    def take_transforms(self, transforms: Message, received: Received) -> None:
        """Take a tf2_msgs/TFMessage of /tf."""
        del received
        self._grow(transforms, static=False)

    def take_static_transforms(self, transforms: Message, received: Received) -> None:
        """Take a tf2_msgs/TFMessage of /tf_static."""
        del received
        self._grow(transforms, static=True)

    def _grow(self, transforms: Message, *, static: bool) -> None:
        with self._lock:
            for time, parent, child, translation, rotation in transforms_from(transforms):
                try:
                    if not static and self._order(child, time) is Order.SET_BACK:
                        # What was stamped before would count as newer until the clock is there again.
                        self._tree.forget_moving()
                    self._tree.add(time, parent, child, translation, rotation, static=static)
                except MappingError as error:
                    log.debug("transform refused: %s", error)  # the bridge warns of it
            newest = self._tree.newest(self._frames.map, self._frames.base)
            found = None if newest is None else self._tree.lookup(self._frames.map, self._frames.base, newest, 0.0)
            if found is not None:
                self._at(found.pose)

    def _order(self, stream: str, stamp: float) -> Order:
        order = self._orders.setdefault(stream, StampOrder()).take(stamp)
        if order is Order.SET_BACK:
            self._orders = {stream: self._orders[stream]}
        return order

    def _at(self, pose: Pose) -> None:
        inside = self._fence.holds(pose)
        if inside != self._inside:
            self._inside = inside
            self._tell("" if inside else f"({pose.x:.2f}, {pose.y:.2f})")
