"""What the bridge says: waypoint, path, beacon, status, figures, belief, markers."""

from __future__ import annotations

import json
from math import atan2
from typing import Any, Final

from common.geometry import Pose
from common.planners.base import Planner, Position
from common.tasks import find_task
from deploy.bridge.diagnostics import diagnostics
from deploy.bridge.mission import Phase
from deploy.bridge.outcome import Outcome
from deploy.bridge.scene import scene
from deploy.bridge.standing import Standing
from deploy.bridge.status import Status
from deploy.config import DeployConfig
from deploy.ros2 import LATCHED, RELIABLE, Message, Node, Publisher, QoS, message
from deploy.ros2.conversions import occupancy_grid, path, point_stamped, pose_stamped
from deploy.ros2.names import topic_name

# A navigation stack whose robot has stood for so long, seconds, is told its goal again: it was not ready yet, refused
# it, gave it up, or thinks that it is there. Its own recoveries (nav2 waits for 5 s) move the robot sooner.
_GOAL_AGAIN: Final = 10.0
# Nobody may have listened for so long, seconds, before the robot counts as one that nobody drives: links come back.
_UNHEARD: Final = 3.0


class Outputs:
    """Publishes on the topics that the configuration names."""

    def __init__(self, node: Node, config: DeployConfig) -> None:
        """Declare the publishers."""
        self._config = config
        self._frame = config.frames.map
        self._publishers: dict[str, Publisher] = {}
        self._sent_pose: Position | None = None
        self._sent_aim: Position | None = None
        self._was_going = False
        self._pose: Pose | None = None
        self._standing = Standing()
        self._heard: float | None = None
        topics = config.topics
        self._velocity = topic_name(topics.velocity, node.namespace, topics.remap) if topics.velocity else ""
        self._next_waypoint = self._next_diagnostics = float("-inf")
        for name, kind, qos in (
            ("waypoint", "geometry_msgs/msg/PointStamped", RELIABLE),
            ("waypoint_pose", "geometry_msgs/msg/PoseStamped", RELIABLE),
            ("path", "nav_msgs/msg/Path", RELIABLE),
            ("beacon", "geometry_msgs/msg/PointStamped", RELIABLE),
            ("status", "std_msgs/msg/String", RELIABLE),
            ("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", RELIABLE),
            ("markers", "visualization_msgs/msg/MarkerArray", QoS(depth=1)),
            ("scene", "std_msgs/msg/String", QoS(depth=1)),
            ("belief", "nav_msgs/msg/OccupancyGrid", LATCHED),
            ("speed", "std_msgs/msg/Float32", RELIABLE),
            ("finished", "std_msgs/msg/Bool", RELIABLE),
            ("goal_reached", "std_msgs/msg/Bool", RELIABLE),
            ("runtime", "std_msgs/msg/Float32", RELIABLE),
            ("explored_volume", "std_msgs/msg/Float32", RELIABLE),
            ("travelling_distance", "std_msgs/msg/Float32", RELIABLE),
            ("time_duration", "std_msgs/msg/Float32", RELIABLE),
        ):
            topic = getattr(config.topics, name)
            if topic:
                self._publishers[name] = node.publisher(topic, kind, qos)

    def decision(self, outcome: Outcome, stamp: float, now: float) -> None:
        """Publish where the robot goes: with every decision, and at its rate in between.

        A robot that has to stand is sent to where it is, once, so that a stack of its own stops as well; where its pose
        is lost, that is the last one.

        Args:
            outcome: of this pass of the decision loop.
            stamp: robot time, seconds.
            now: monotonic seconds.
        """
        course = outcome.course
        pose = self._pose = outcome.pose or self._pose
        if course is None:
            self._standing.reset()
            self._sent_aim = None
            if self._was_going and pose is not None:
                self._send("waypoint", point_stamped(stamp, self._frame, pose.position))
                self._send_pose(pose.position, pose, stamp)
                self._send("path", path(stamp, self._frame, []))
            self._was_going = False
            return
        self._was_going = True
        if self._standing.seconds(now, pose) >= _GOAL_AGAIN:
            self._standing.reset()
            self._sent_pose = None
            self._send_pose(course.waypoint, pose, stamp)
        aim = outcome.aim or course.waypoint
        if not outcome.decided and aim == self._sent_aim and now < self._next_waypoint:
            return
        self._next_waypoint, self._sent_aim = now + 1.0 / self._config.decision.rate, aim
        self._send("waypoint", point_stamped(stamp, self._frame, aim))
        # A navigation stack plans its own way: it is told where that ends, and not every corner.
        self._send_pose(course.waypoint, pose, stamp)
        self._send("path", path(stamp, self._frame, [*course.via, course.waypoint, *course.path]))
        if course.beacon is not None:
            self._send("beacon", point_stamped(stamp, self._frame, course.beacon))
        self._number("speed", self._config.driving.max_speed)
        if outcome.decided:
            self._number("runtime", outcome.seconds)

    def unheard(self, now: float, *, velocity_heard: bool = True) -> str:
        """Say that nobody hears where the robot is to go, or its velocities where the bridge drives; empty otherwise.

        Args:
            now: monotonic seconds.
            velocity_heard: somebody listens to what the watchdog sends.
        """
        name = "waypoint_pose" if "waypoint_pose" in self._publishers else "waypoint"
        publisher, driving = self._publishers.get(name), self._config.driving
        heard = velocity_heard if driving.enabled else publisher is None or publisher.heard
        if heard or self._heard is None:
            self._heard = now
        if now - self._heard <= _UNHEARD:
            return ""
        if publisher is None or driving.enabled:
            return (
                f"nobody listens on {self._velocity} to velocities of the type {driving.message}: start the driver of "
                "the base, or correct topics.velocity or driving.message (`hd-deploy topics` lists who listens)"
            )
        return (
            f"nobody listens on {publisher.topic} to where the robot is to go: start the stack that drives it, or "
            f"correct topics.{name}, which may be empty"
        )

    def status(self, status: Status, outcome: Outcome, explored_volume: float, stamp: float, now: float) -> None:
        """Publish the status, the figures of the CMU stack's planners, and once a second the diagnostics.

        Args:
            status: of this moment.
            outcome: of the last pass of the decision loop.
            explored_volume: cubic metres.
            stamp: robot time, seconds.
            now: monotonic seconds.
        """
        self._send("status", message("std_msgs/msg/String", data=json.dumps(status.to_json())))
        self._number("explored_volume", explored_volume)
        self._number("travelling_distance", status.distance)
        self._number("time_duration", status.duration)
        finished = outcome.orders.phase is Phase.FINISHED
        self._send("finished", message("std_msgs/msg/Bool", data=finished))
        if find_task(status.task).needs_target:
            self._send("goal_reached", message("std_msgs/msg/Bool", data=finished))
        if "diagnostics" in self._publishers and now >= self._next_diagnostics:
            self._next_diagnostics = now + 1.0
            ros = self._config.ros
            self._send("diagnostics", diagnostics(status, stamp, ros.node, ros.distro))

    def belief(self, outcome: Outcome, stamp: float) -> None:
        """Publish the belief that the planner plans on."""
        if outcome.mapper is not None:
            belief = outcome.mapper.belief
            self._send("belief", occupancy_grid(stamp, self._frame, belief.cells, belief.resolution, belief.origin))

    def markers(self, drawn: Message) -> None:
        """Publish what `drawing.draw` made."""
        self._send("markers", drawn)

    def scene(self, outcome: Outcome, planner: Planner) -> None:
        """Publish what the planner sees, where the topic has a name."""
        if "scene" in self._publishers:
            seen = scene(outcome, planner)
            if seen is not None:
                self._send("scene", seen)

    def _send_pose(self, position: Position, pose: Pose | None, stamp: float) -> None:
        # A navigation stack begins anew with every goal pose, so it hears of changes alone.
        if position != self._sent_pose:
            self._sent_pose = position
            yaw = 0.0 if pose is None else pose.yaw
            if pose is not None and position != pose.position:
                yaw = atan2(position[1] - pose.y, position[0] - pose.x)
            self._send("waypoint_pose", pose_stamped(stamp, self._frame, Pose(*position, yaw)))

    def _number(self, name: str, value: float) -> None:
        self._send(name, message("std_msgs/msg/Float32", data=value))

    def _send(self, name: str, what: Any) -> None:
        publisher = self._publishers.get(name)
        if publisher is not None:
            publisher.publish(what)
