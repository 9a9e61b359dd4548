"""An action of a node: three services and two topics below `<name>/_action`, as ROS 2 makes them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from enum import IntEnum
from typing import Final

from common.system.closing import Closing
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, message, stamp
from deploy.ros2.node import Node
from deploy.ros2.qos import RELIABLE, QoS

_STATUS: Final = QoS(transient_local=True, depth=1)
_REJECTED, _UNKNOWN, _OVER = 1, 2, 3
# So many clients may wait for results at the same time.
_WAITING: Final = 8
_FORGOTTEN: Final = 16


class GoalState(IntEnum):
    """States, numbered as in action_msgs/msg/GoalStatus."""

    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class Goal:
    """A goal that was accepted.

    Attributes:
        id: 16 bytes.
        request: the goal itself.
        state: of this moment.
        result: once it has ended.
    """

    def __init__(self, id_: bytes, request: Message, accepted: float) -> None:
        self.id = id_
        self.request = request
        self.accepted = accepted
        self.state = GoalState.EXECUTING
        self.result: Message | None = None
        self.ended = threading.Event()


class ActionServer(Closing):
    """Carries out one goal at a time: a new one takes the place of the one before, which is aborted.

    Usage::

        server = ActionServer(node, "~/navigate_to_pose", "nav2_msgs/action/NavigateToPose", accept, cancel)
        goal = server.goal
        if goal is not None and arrived:
            server.end(goal, GoalState.SUCCEEDED)
    """

    def __init__(
        self, node: Node, name: str, kind: str, accept: Callable[[Message], bool], cancel: Callable[[], bool]
    ) -> None:
        """Offer the action.

        Args:
            node: whose action it is.
            name: absolute, relative, or below the node, such as `~/navigate_to_pose`.
            kind: such as `nav2_msgs/action/NavigateToPose`.
            accept: takes up a goal, or says that it cannot.
            cancel: begins to leave the goal of this moment, or says that it cannot.

        Raises:
            RosError: for a malformed name or an unknown type.
        """
        self._kind = kind
        self._distro = node.distro
        self._accept = accept
        self._cancel = cancel
        self._lock = threading.RLock()
        self._goals: dict[bytes, Goal] = {}
        self._closed = False
        self.goal: Goal | None = None
        """The goal under way, None while there is none."""
        base = f"{name}/_action"
        self._status = node.publisher(node.resolve(f"{base}/status"), "action_msgs/msg/GoalStatusArray", _STATUS)
        self._feedback = node.publisher(node.resolve(f"{base}/feedback"), f"{kind}_FeedbackMessage", RELIABLE)
        self._services = [
            node.service(f"{base}/send_goal", f"{kind}_SendGoal", self._send_goal),
            node.service(f"{base}/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel_goal),
            node.service(f"{base}/get_result", f"{kind}_GetResult", self._get_result, _WAITING),
        ]

    def end(self, goal: Goal, state: GoalState, **result: object) -> None:
        """End a goal.

        Args:
            goal: under way.
            state: SUCCEEDED, CANCELED or ABORTED.
            result: fields of the result.
        """
        with self._lock:
            if goal.result is not None:
                return
            goal.state = state
            goal.result = message(f"{self._kind}_Result", self._distro, **result)
            goal.ended.set()
            if self.goal is goal:
                self.goal = None
            self._publish_status()

    def tell(self, goal: Goal, **feedback: object) -> None:
        """Publish how far a goal has come; the fields are those of the feedback."""
        inner = message(f"{self._kind}_Feedback", self._distro, **feedback)
        self._feedback.publish(
            message(f"{self._kind}_FeedbackMessage", self._distro, goal_id=self._uuid(goal.id), feedback=inner)
        )

    def close(self) -> None:
        """Abort what is under way and withdraw the action. Safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            if self.goal is not None:
                self.end(self.goal, GoalState.ABORTED)
        for service in self._services:
            service.close()

    def _send_goal(self, request: Message) -> Message:
        goal = Goal(bytes(request.goal_id.uuid), request.goal, time.time())
        with self._lock:
            accepted = not self._closed and goal.id not in self._goals and self._accept(goal.request)
            if accepted:
                if self.goal is not None:
                    self.end(self.goal, GoalState.ABORTED)
                self._goals[goal.id] = self.goal = goal
                while len(self._goals) > _FORGOTTEN:
                    del self._goals[next(iter(self._goals))]
                self._publish_status()
        return message(f"{self._kind}_SendGoal_Response", self._distro, accepted=accepted, stamp=stamp(goal.accepted))

    def _cancel_goal(self, request: Message) -> Message:
        wanted, goal = bytes(request.goal_info.goal_id.uuid), self.goal
        canceling, code = [], 0
        if any(wanted) and (goal is None or goal.id != wanted):
            code = _OVER if wanted in self._goals else _UNKNOWN
        elif goal is not None:
            # Said first: the goal may end at once.
            goal.state = GoalState.CANCELING
            if self._cancel():
                canceling = [self._info(goal)]
            else:
                goal.state, code = GoalState.EXECUTING, _REJECTED
        return message("action_msgs/srv/CancelGoal_Response", self._distro, return_code=code, goals_canceling=canceling)

    def _get_result(self, request: Message) -> Message:
        goal = self._goals.get(bytes(request.goal_id.uuid))
        if goal is None:
            raise RosError("no goal with this id")
        goal.ended.wait()
        return message(f"{self._kind}_GetResult_Response", self._distro, status=int(goal.state), result=goal.result)

    def _publish_status(self) -> None:
        statuses = [
            message("action_msgs/msg/GoalStatus", self._distro, goal_info=self._info(goal), status=int(goal.state))
            for goal in self._goals.values()
        ]
        self._status.publish(message("action_msgs/msg/GoalStatusArray", self._distro, status_list=statuses))

    def _info(self, goal: Goal) -> Message:
        return message(
            "action_msgs/msg/GoalInfo", self._distro, goal_id=self._uuid(goal.id), stamp=stamp(goal.accepted)
        )

    def _uuid(self, id_: bytes) -> Message:
        return message("unique_identifier_msgs/msg/UUID", self._distro, uuid=list(id_))
