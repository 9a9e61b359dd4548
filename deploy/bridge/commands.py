"""Commands to the robot: from the bus and from ROS topics, carried out in one place, each acknowledged."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Mapping
from math import isfinite, nan
from typing import Any, Final, Protocol

from common.errors import HDError
from common.messages.replies import ROBOT_VERBS, ControlRequest
from common.planners.base import Position
from deploy.bridge.command_text import RELEASE, CommandError, parse, release_of
from deploy.bridge.mission import Mission
from deploy.network_config import FramesConfig, TopicsConfig
from deploy.ros2 import Message, Node, Received, RosError, message
from deploy.ros2.conversions import pose_from_stamped, position_from
from deploy.safety.gate_state import emergency_reason

log = logging.getLogger(__name__)

# Of what a peer sent, an answer and the log repeat no more characters.
_SHOWN: Final = 40
# Commands that may set the robot in motion.
_ORDERS: Final = frozenset({"start", "resume", "return_home", "goal", "explore"})
# The watchdog confirms a release within this time, seconds.
_CONFIRMED: Final = 1.0


class Stopper(Protocol):
    """What commands need of `deploy.safety.gate.VelocityGate`."""

    @property
    def latched(self) -> bool:
        """Whether the emergency stop is latched."""
        ...

    def emergency_stop(self, reason: str) -> None:
        """Latch the emergency stop."""
        ...

    def release(self) -> None:
        """Release the emergency stop."""
        ...


class Commands:
    """Carries commands out and answers with the state after them.

    Usage::

        commands = Commands(mission, gate, lambda: status.to_json())
        commands.carry_out("goal", {"x": 4.0, "y": 2.5})
    """

    def __init__(
        self,
        mission: Mission,
        gate: Stopper,
        state: Callable[[], dict[str, Any]],
        on_order: Callable[[], None] = lambda: None,
    ) -> None:
        """Command a mission and a watchdog.

        Args:
            mission: the robot's orders.
            gate: of the watchdog.
            state: makes the answer.
            on_order: called before an order to move is carried out.
        """
        self._mission = mission
        self._gate = gate
        self._state = state
        self._on_order = on_order
        self._plain: dict[str, Callable[[], None]] = {
            "status": lambda: None,
            "start": mission.start,
            "pause": mission.pause,
            "resume": mission.resume,
            "abort": mission.abort,
            "return_home": mission.return_home,
            "reset": mission.reset,
            "explore": mission.explore,
        }

    def __call__(self, request: ControlRequest) -> dict[str, Any]:
        """Carry out a command of the bus; see `carry_out`."""
        return self.carry_out(request.verb, request.arguments)

    def carry_out(self, verb: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out one command and return the robot's state after it.

        Args:
            verb: one of `ROBOT_VERBS`.
            arguments: ``x`` and ``y`` of a goal, metres; ``who`` and ``why`` of a release; perhaps a ``reason`` for a
                stop; else empty.

        Raises:
            CommandError: it is unknown, lacks an argument, or cannot be carried out now.
        """
        if verb != "status":
            log.info("command: %s%s", verb, f" {str(dict(arguments))[:200]}" if arguments else "")
        if verb in _ORDERS:
            if self._gate.latched:
                raise CommandError(f"the emergency stop is latched: release it first, by {RELEASE}")
            self._on_order()
        if verb == "goal":
            self._mission.goal(_position(arguments))
        elif verb == "stop":
            self._stop(str(arguments.get("reason", "by command"))[:200])
        elif verb == "release":
            self._release(*release_of(arguments))
        elif verb in self._plain:
            self._plain[verb]()
        else:
            raise CommandError(f"a command must be one of {', '.join(ROBOT_VERBS)}, got {verb!r}")
        return self._state()

    def _stop(self, reason: str) -> None:
        self._gate.emergency_stop(reason)
        self._mission.emergency_stop(emergency_reason(reason))

    def _release(self, who: str, why: str) -> None:
        """Release the emergency stop; the robot stands until it is told to start."""
        latched = self._gate.latched
        self._mission.emergency_stop(f"emergency stop released by {who}: {why}")
        self._gate.release()
        log.warning("the emergency stop is released by %s: %s", who, why)
        until = time.monotonic() + _CONFIRMED
        while self._gate.latched:
            if time.monotonic() > until:
                raise CommandError(
                    "the emergency stop stays latched: its topic says so again, or the watchdog does not answer"
                )
            time.sleep(0.01)
        if latched:
            self._mission.released(who, why)


class TopicCommands:
    """Takes commands from ROS topics and answers on the topic of acknowledgements.

    std_msgs/String carries a verb, with `goal X Y` for targets; Bool starts; PointStamped and PoseStamped are targets.
    An answer is JSON: ``command``, ``ok``, ``error``, ``state`` and ``reason``.
    """

    def __init__(self, commands: Commands, node: Node, topics: TopicsConfig, frames: FramesConfig) -> None:
        """Listen to these topics, where they have a name."""
        self._commands = commands
        self._map_frame = frames.map
        self._answers = (
            node.publisher(topics.acknowledgement, "std_msgs/msg/String") if topics.acknowledgement else None
        )
        wanted: list[tuple[str, str, Callable[[Message, Received], None]]] = [
            (topics.command, "std_msgs/msg/String", self._on_command),
            (topics.start, "std_msgs/msg/Bool", self._on_start),
            (topics.goal, "geometry_msgs/msg/PointStamped", self._on_goal),
            (topics.goal_pose, "geometry_msgs/msg/PoseStamped", self._on_goal_pose),
        ]
        for topic, kind, callback in wanted:
            if topic:
                node.subscribe(topic, kind, callback)

    def _on_command(self, command: Message, received: Received) -> None:
        del received
        self._answer(command.data[:200], lambda: _of_topic(command.data))

    def _on_start(self, start: Message, received: Received) -> None:
        del received
        if start.data:
            self._answer("start", lambda: ("start", {}))

    def _on_goal(self, goal: Message, received: Received) -> None:
        del received
        self._answer("goal", lambda: self._goal(goal.header.frame_id, position_from(goal)[1]))

    def _on_goal_pose(self, goal: Message, received: Received) -> None:
        del received
        self._answer("goal", lambda: self._goal(goal.header.frame_id, pose_from_stamped(goal)[1].position))

    def _goal(self, frame: str, position: Position) -> tuple[str, dict[str, Any]]:
        x, y = target_in(self._map_frame, frame, position)
        return "goal", {"x": x, "y": y}

    def _answer(self, text: str, read: Callable[[], tuple[str, Mapping[str, Any]]]) -> None:
        answer: dict[str, Any] = {"command": text, "ok": True, "error": ""}
        try:
            state = self._commands.carry_out(*read())
            answer |= {"state": state.get("state"), "reason": state.get("reason")}
        except HDError as error:
            log.warning("command %r refused: %s", text, error)
            answer |= {"ok": False, "error": str(error)}
        if self._answers is not None:
            try:
                self._answers.publish(message("std_msgs/msg/String", data=json.dumps(answer)))
            except RosError as error:
                log.warning("command %r could not be acknowledged: %s", text, error)


def target_in(map_frame: str, frame: str, position: Position) -> Position:
    """Return the position of a target that came with a frame.

    Raises:
        CommandError: it is another frame than the map's.
    """
    if frame.lstrip("/") not in {"", map_frame}:
        raise CommandError(f"a target must be given in the frame {map_frame!r}, got {frame!r}")
    return position


def _of_topic(text: str) -> tuple[str, dict[str, Any]]:
    """Read a command of a topic, where anybody may publish."""
    verb, arguments = parse(text)
    if verb == "release":
        raise CommandError(f"no topic releases the emergency stop: an operator does, by {RELEASE}")
    return verb, arguments


def _position(arguments: Mapping[str, Any]) -> Position:
    """Return the place of a goal; whatever a peer sent instead of two numbers of metres is refused in one sentence."""
    try:
        x, y = float(arguments["x"]), float(arguments["y"])
    except (KeyError, TypeError, ValueError, OverflowError):
        x = y = nan
    if not (isfinite(x) and isfinite(y)):
        came = {name: str(value)[:_SHOWN] for name, value in list(arguments.items())[:4]}
        raise CommandError(f"a goal needs two finite numbers x and y, metres in the map frame, got {came}")
    return x, y
