"""Targets as nav2's action: whoever sent the robot to a place hears how far it has come, and that it is there."""

from __future__ import annotations

import logging
from math import hypot
from typing import Any, Final

from common.errors import HDError
from common.planners.base import Position
from common.system.closing import Closing
from deploy.bridge.commands import Commands, target_in
from deploy.bridge.mission import Mission, Phase
from deploy.bridge.outcome import Outcome
from deploy.ros2 import Message, Node, message
from deploy.ros2.actions import ActionServer, GoalState
from deploy.ros2.conversions import pose_from_stamped, pose_stamped

log = logging.getLogger(__name__)

KIND: Final = "nav2_msgs/action/NavigateToPose"
# Of nav2's error codes, the one for what has no other.
_UNKNOWN: Final = 9000


class NavigateAction(Closing):
    """Offers nav2_msgs/action/NavigateToPose: a goal is the command `goal`, and `start` where the robot waits.

    To cancel is to abort. Another target, `explore` and `return-home` abort a goal; `pause` keeps it, and one that
    comes during a pause waits for `resume`.
    """

    def __init__(
        self, node: Node, name: str, commands: Commands, mission: Mission, *, map_frame: str, goal_radius: float
    ) -> None:
        """Offer the action.

        Args:
            node: of the bridge.
            name: of the action.
            commands: that goals become.
            mission: the robot's orders.
            map_frame: name of the frame that goals and poses are in.
            goal_radius: a robot so near to a goal has reached it, metres.
        """
        self._map_frame = map_frame
        self._goal_radius = goal_radius
        self._commands = commands
        self._mission = mission
        self._target: Position = (0.0, 0.0)
        self._began = 0.0
        self._server = ActionServer(node, name, KIND, self._accept, self._cancel)

    def look(self, outcome: Outcome, stamp: float, now: float) -> None:
        """Tell whoever waits what has become of the goal.

        Args:
            outcome: of the last pass of the decision loop.
            stamp: robot time, seconds.
            now: monotonic seconds.
        """
        goal, orders, pose = self._server.goal, self._mission.orders, outcome.pose
        if goal is None:
            self._began = now
            return
        distance = float("inf") if pose is None else hypot(pose.x - self._target[0], pose.y - self._target[1])
        if orders.target != self._target or not orders.task.needs_target:
            self._end(GoalState.ABORTED, "another command arrived")
        elif orders.phase is Phase.FINISHED or (orders.phase is Phase.RETURNING and distance <= self._goal_radius):
            self._end(GoalState.SUCCEEDED, "")
        elif orders.phase is Phase.ABORTED:
            canceled = goal.state is GoalState.CANCELING
            self._end(GoalState.CANCELED if canceled else GoalState.ABORTED, "" if canceled else orders.reason)
        elif orders.phase in {Phase.FAILED, Phase.RETURNING}:
            self._end(GoalState.ABORTED, orders.reason)
        elif pose is not None:
            self._server.tell(
                goal,
                current_pose=pose_stamped(stamp, self._map_frame, pose),
                navigation_time=_duration(now - self._began),
                distance_remaining=distance,
            )

    def close(self) -> None:
        """Withdraw the action."""
        self._server.close()

    def _accept(self, goal: Message) -> bool:
        try:
            _, pose = pose_from_stamped(goal.pose)
            target = target_in(self._map_frame, goal.pose.header.frame_id, pose.position)
            self._commands.carry_out("goal", {"x": target[0], "y": target[1]})
            # A pause is an operator's: whoever sends goals does not end it.
            if not self._mission.orders.moving and self._mission.orders.phase is not Phase.PAUSED:
                self._commands.carry_out("start", {})
        except HDError as error:
            log.warning("a goal of the action is rejected: %s", error)
            return False
        self._target = target
        return True

    def _cancel(self) -> bool:
        self._commands.carry_out("abort", {})
        return True

    def _end(self, state: GoalState, why: str) -> None:
        goal = self._server.goal
        if goal is not None:
            fields: dict[str, Any] = {"error_code": _UNKNOWN if why else 0, "error_msg": why}
            self._server.end(goal, state, **fields)


def _duration(seconds: float) -> Message:
    whole = int(seconds)
    return message("builtin_interfaces/msg/Duration", sec=whole, nanosec=int((seconds - whole) * 1e9))
