"""Decides anew by a recording, with the map, the planners and the decision loop of the bridge."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from common.errors import HDError
from common.system.documents import parse_json
from deploy.bridge.command_text import parse
from deploy.bridge.commands import Commands
from deploy.bridge.decision import DecisionLoop
from deploy.bridge.inputs import Inputs
from deploy.bridge.mission import Mission
from deploy.bridge.outcome import Outcome
from deploy.bridge.planner_selector import make_planners, with_planning_set
from deploy.config import DeployConfig
from deploy.mapping.robot_map import RobotMap
from deploy.network_config import TopicsConfig
from deploy.recording.comparison import Decision
from deploy.recording.reader import Recorded
from deploy.recording.steady import without_clock_steps
from deploy.ros2 import Message, Received, RosError
from deploy.ros2.conversions import pose_from_stamped, position_from
from deploy.ros2.messages import deserialize
from deploy.ros2.names import namespace, topic_name
from deploy.safety.geofence import Geofence
from deploy.safety.health import HealthMonitor

log = logging.getLogger(__name__)

# As often as the bridge's own loop.
_PASS: Final = 0.1
_STANDING: Final = 0.05
_MOVING: Final = frozenset({"running", "holding", "returning"})


class _NoGate:
    """Stands where the watchdog is: a replay drives nothing."""

    def emergency_stop(self, reason: str) -> None:
        """Do nothing."""
        del reason

    @property
    def latched(self) -> bool:
        """Nothing is."""
        return False

    def release(self) -> None:
        """Do nothing."""


@dataclass(slots=True)
class Playback:
    """What came of a replay.

    Attributes:
        begin: arrival of the first message, seconds since 1970.
        recorded: waypoints of the recording, in order.
        decided: waypoints decided anew, whenever they changed.
        seconds: times of the planners' decisions, map included.
        faults: passes with a fault of each kind.
        end: phase in which the replay ended, and why.
        map_statistics: what became of the sensor messages.
    """

    begin: float = 0.0
    recorded: list[Decision] = field(default_factory=list)
    decided: list[Decision] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    faults: dict[str, int] = field(default_factory=dict)
    end: tuple[str, str] = ("idle", "")
    map_statistics: Any = None


class BagPlayer:
    """Feeds the messages of a recording to a bridge without a network, on the clock of the recording.

    Commands and targets are taken from their topics, and from the recorded status, since commands by `hd-deploy
    command` are on no topic. Without either, the replay starts as soon as there is a map.

    Usage::

        replayed = BagPlayer(config, self_start=False).run(read_bag(path))
    """

    def __init__(
        self, config: DeployConfig, self_start: bool, listener: Callable[[Outcome, float], None] | None = None
    ) -> None:
        """Prepare planners and map.

        Args:
            config: of the bridge.
            self_start: start as soon as there is a map, because the recording tells nothing of a start.
            listener: gets the outcome and the time of every pass.

        Raises:
            HDError: a planner cannot be had.
        """
        self._config = config
        self._self_start = self_start
        self._listener = listener
        self._now = 0.0
        planners = make_planners(config)
        self._map = RobotMap(with_planning_set(config, planners), config.decision.goal)
        self._health = HealthMonitor(config.safety, Geofence.around_robot(config), config.sensing.source)
        self._mission = Mission(config.decision.task, config.decision.goal)
        self._inputs = Inputs(config, self._map, self._health)
        self._loop = DecisionLoop(
            config.decision,
            config.mapping,
            config.safety,
            self._map,
            planners,
            self._mission,
            self._health,
            clock=lambda: self._now,
        )
        self._commands = Commands(self._mission, _NoGate(), dict)
        self._result = Playback()
        self._takers = self._by_topic()

    @property
    def topics(self) -> set[str]:
        """Absolute names of the topics that a replay uses."""
        return {topic for topic, _ in self._takers}

    def run(self, messages: Iterable[Recorded]) -> Playback:
        """Replay to the end and return what was decided."""
        result = self._result
        due = 0.0
        for recorded in without_clock_steps(messages):
            arrival = recorded.time * 1e-9
            if self._now == 0.0:
                result.begin = self._now = arrival
                due = arrival + _PASS
            while due <= arrival:
                self._now = max(self._now, due)
                self._pass()
                due += _PASS
            self._now = max(self._now, arrival)
            self._take(recorded)
        self._pass()
        orders = self._mission.orders
        result.end = orders.phase.value, orders.reason
        result.map_statistics = self._map.statistics
        return result

    def _take(self, recorded: Recorded) -> None:
        take = self._takers.get((recorded.topic, recorded.kind))
        if take is None:
            return
        try:
            message = deserialize(recorded.payload, recorded.kind, self._config.ros.distro)
            take(message, Received(self._now, recorded.time, len(recorded.payload)))
        except RosError as error:
            log.debug("%s: %s", recorded.topic, error)
        except HDError as error:
            log.info("at %.1f s: %s", self._now - self._result.begin, error)

    def _pass(self) -> None:
        """Run one pass of the decision loop, as the bridge does."""
        if self._self_start and self._map.refresh() is not None and (
            not self._mission.task.needs_target or self._mission.orders.target is not None
        ):  # fmt: skip
            self._self_start = False
            self._mission.start()
        outcome = self._loop.step()
        if outcome.decided:
            self._result.seconds.append(outcome.seconds)
        for fault in outcome.faults:
            self._result.faults[fault.kind.value] = self._result.faults.get(fault.kind.value, 0) + 1
        waypoint = None if outcome.course is None else outcome.course.waypoint
        decided = self._result.decided
        if not decided or decided[-1].waypoint != waypoint:
            beacon = None if outcome.course is None else outcome.course.beacon
            where = None if outcome.pose is None else outcome.pose.position
            decided.append(Decision(self._now, waypoint, beacon, where))
        if self._listener is not None:
            self._listener(outcome, self._now)

    def _by_topic(self) -> dict[tuple[str, str], Callable[[Message, Received], None]]:
        topics, inputs = self._config.topics, self._inputs
        within = namespace(self._config.ros.namespace)
        wanted: list[tuple[str, str, Callable[[Message, Received], None]]] = [
            (topics.odometry, "nav_msgs/msg/Odometry", inputs.take_odometry),
            (topics.tf, "tf2_msgs/msg/TFMessage", inputs.take_transforms),
            (topics.tf_static, "tf2_msgs/msg/TFMessage", inputs.take_static_transforms),
            (topics.scan, "sensor_msgs/msg/LaserScan", inputs.take_scan),
            (topics.points, "sensor_msgs/msg/PointCloud2", inputs.take_points),
            (topics.map, "nav_msgs/msg/OccupancyGrid", inputs.take_grid),
            (topics.command, "std_msgs/msg/String", self._on_command),
            (topics.start, "std_msgs/msg/Bool", self._on_start),
            (topics.goal, "geometry_msgs/msg/PointStamped", self._on_goal),
            (topics.goal_pose, "geometry_msgs/msg/PoseStamped", self._on_goal_pose),
            (topics.status, "std_msgs/msg/String", self._on_status),
            (topics.waypoint, "geometry_msgs/msg/PointStamped", self._on_waypoint),
        ]
        return {
            (topic_name(topic, within, topics.remap), kind): take for topic, kind, take in wanted if topic
        }  # fmt: skip

    def _on_command(self, command: Message, received: Received) -> None:
        del received
        self._commands.carry_out(*parse(command.data))

    def _on_start(self, start: Message, received: Received) -> None:
        del received
        if start.data:
            self._mission.start()

    def _on_goal(self, goal: Message, received: Received) -> None:
        del received
        self._mission.goal(position_from(goal)[1])

    def _on_goal_pose(self, goal: Message, received: Received) -> None:
        del received
        self._mission.goal(pose_from_stamped(goal)[1].position)

    def _on_status(self, status: Message, received: Received) -> None:
        """Follow orders that came by no topic."""
        del received
        try:
            told = parse_json(status.data)
            state, target = str(told["state"]), told["target"]
            task = told.get("task", self._mission.task.name)
        except (ValueError, TypeError, KeyError):
            return
        orders = self._mission.orders
        asked = self._mission.task
        if target is not None and (asked.needs_target or task != asked.name) and orders.target != tuple(target):
            self._mission.goal((float(target[0]), float(target[1])))
        elif task == asked.name and orders.task is not asked:
            self._mission.explore()
        if state in _MOVING and orders.phase.value in {"idle", "paused", "aborted"}:
            self._mission.start()
        elif state == "paused" and orders.moving:
            self._mission.pause()
        elif state == "aborted" and orders.phase.value != "aborted":
            self._mission.abort()

    def _on_waypoint(self, waypoint: Message, received: Received) -> None:
        position = position_from(waypoint)[1]
        pose = self._map.pose
        here = None if pose is None else pose.position
        # A bridge that stands sends the robot to where it is.
        stands = here is not None and abs(here[0] - position[0]) + abs(here[1] - position[1]) < _STANDING
        if not stands and self._mission.orders.phase.value == "idle":
            # The status that tells of the start may come later than the first waypoint.
            self._mission.start()
        self._result.recorded.append(Decision(received.time, None if stands else position, None, here))


def has_decisions(topics: Iterable[str], named: TopicsConfig, robot_namespace: str) -> bool:
    """Whether a recording with these topics tells when its bridge, with topics so named, was started."""
    within = namespace(robot_namespace)
    telling = {
        topic_name(topic, within, named.remap)
        for topic in (named.status, named.command, named.start)
        if topic
    }  # fmt: skip
    return not telling.isdisjoint(topics)
