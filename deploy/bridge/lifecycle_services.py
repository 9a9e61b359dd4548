"""The bridge as a lifecycle node of ROS 2: `~/get_state`, `~/change_state` and what lists states and transitions."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Final, cast, get_args

from common.errors import HDError
from deploy.bridge.commands import Commands
from deploy.ros2 import Message, Node, message
from deploy.ros2.definitions import service_name
from deploy.safety.lifecycle import Lifecycle, LifecycleState, Transition

log = logging.getLogger(__name__)

_STATE: Final = LifecycleState
# Ids of lifecycle_msgs/msg/Transition; a shutdown has one for each state that it may begin in.
_TRANSITIONS: Final[dict[int, Transition]] = {
    1: "configure",
    2: "cleanup",
    3: "activate",
    4: "deactivate",
    5: "shutdown",
    6: "shutdown",
    7: "shutdown",
}
_SHUTDOWN_IDS: Final = {_STATE.UNCONFIGURED: 5, _STATE.INACTIVE: 6, _STATE.ACTIVE: 7}
_GOALS: Final[dict[Transition, LifecycleState]] = {
    "configure": _STATE.INACTIVE,
    "cleanup": _STATE.UNCONFIGURED,
    "activate": _STATE.ACTIVE,
    "deactivate": _STATE.INACTIVE,
    "shutdown": _STATE.FINALIZED,
}
# The decision loop follows orders ten times a second.
_FOLLOWED: Final = 2.0


class LifecycleServices:
    """Carries out transitions as commands to the robot, so that every one of them does what an operator's would.

    To activate is to start, to deactivate is to pause, to clean up is to abort and to forget the map, to shut down is
    to end the bridge. A transition to the state that the bridge is in succeeds and does nothing: it configures itself
    when it starts, and managers of lifecycles configure it once more.
    """

    def __init__(self, node: Node, lifecycle: Lifecycle, commands: Commands, end: Callable[[], None]) -> None:
        """Offer the services.

        Args:
            node: of the bridge.
            lifecycle: whose state is told and changed.
            commands: to the robot.
            end: ends the bridge; must not block.
        """
        self._lifecycle = lifecycle
        self._commands = commands
        self._end = end
        self._distro = node.distro
        for kind, handle in (
            ("lifecycle_msgs/srv/GetState", self._get_state),
            ("lifecycle_msgs/srv/ChangeState", self._change_state),
            ("lifecycle_msgs/srv/GetAvailableStates", self._get_states),
            ("lifecycle_msgs/srv/GetAvailableTransitions", self._get_transitions),
        ):
            node.service(f"~/{service_name(kind)}", kind, handle)

    def change(self, transition: Transition) -> None:
        """Make a transition and return when it is made.

        Raises:
            HDError: it is not allowed in this state, or the robot cannot obey.
        """
        state, goal = self._lifecycle.state, _GOALS[transition]
        if state is goal:
            return
        if transition == "activate" and state is _STATE.INACTIVE:
            self._commands.carry_out("start", {})
        elif transition == "deactivate" and state is _STATE.ACTIVE:
            self._commands.carry_out("pause", {})
        elif transition == "cleanup":
            with self._lifecycle.transition(transition):
                self._commands.carry_out("abort", {})
                self._commands.carry_out("reset", {})
        elif transition == "shutdown":
            self._end()
            return
        else:
            self._lifecycle.trigger(transition)
        self._wait_for(goal)

    def _wait_for(self, goal: LifecycleState) -> None:
        until = time.monotonic() + _FOLLOWED
        while self._lifecycle.state is not goal:
            if time.monotonic() > until:
                now = self._lifecycle.state.label
                raise HDError(f"the bridge is {now} and not {goal.label} after {_FOLLOWED:g} s: see its log")
            time.sleep(0.01)

    def _change_state(self, request: Message) -> Message:
        asked = request.transition
        # As in ROS 2, the label counts where the id is 0.
        by_label = cast(Transition, asked.label) if asked.label in get_args(Transition) else None
        transition = _TRANSITIONS.get(asked.id) if asked.id else by_label
        success = False
        try:
            if transition is None:
                raise HDError(f"there is no transition of id {asked.id} and label {str(asked.label)[:40]!r}")
            self.change(transition)
            success = True
        except HDError as error:
            log.warning("a transition is refused: %s", error)
        return message("lifecycle_msgs/srv/ChangeState_Response", self._distro, success=success)

    def _get_state(self, request: Message) -> Message:
        del request
        return message(
            "lifecycle_msgs/srv/GetState_Response", self._distro, current_state=self._state(self._lifecycle.state)
        )

    def _get_states(self, request: Message) -> Message:
        del request
        states = [self._state(state) for state in _STATE]
        return message("lifecycle_msgs/srv/GetAvailableStates_Response", self._distro, available_states=states)

    def _get_transitions(self, request: Message) -> Message:
        del request
        state = self._lifecycle.state
        found = [
            message(
                "lifecycle_msgs/msg/TransitionDescription",
                self._distro,
                transition=message(
                    "lifecycle_msgs/msg/Transition", self._distro, id=_id_of(transition, state), label=transition
                ),
                start_state=self._state(state),
                goal_state=self._state(_GOALS[transition]),
            )
            for transition in self._lifecycle.allowed
        ]
        return message("lifecycle_msgs/srv/GetAvailableTransitions_Response", self._distro, available_transitions=found)

    def _state(self, state: LifecycleState) -> Message:
        return message("lifecycle_msgs/msg/State", self._distro, id=int(state), label=state.label)


def _id_of(transition: Transition, state: LifecycleState) -> int:
    if transition == "shutdown":
        return _SHUTDOWN_IDS[state]
    return next(number for number, name in _TRANSITIONS.items() if name == transition)
