"""Lifecycle states and transitions with the names and numbers of ROS 2 (lifecycle_msgs, design.ros2.org)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import Final, Literal, get_args

from common.errors import HDError

Transition = Literal["configure", "cleanup", "activate", "deactivate", "shutdown"]


class LifecycleError(HDError):
    """A transition is not allowed in this state."""


class LifecycleState(IntEnum):
    """States, numbered as in lifecycle_msgs/msg/State; those from 10 on last only while a transition runs."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4
    CONFIGURING = 10
    CLEANINGUP = 11
    SHUTTINGDOWN = 12
    ACTIVATING = 13
    DEACTIVATING = 14
    ERRORPROCESSING = 15

    @property
    def label(self) -> str:
        """The name that ROS 2 shows."""
        return self.name.lower()


_STATE: Final = LifecycleState
# (state, transition) -> (state while it runs, state afterwards)
_TABLE: Final[dict[tuple[LifecycleState, Transition], tuple[LifecycleState, LifecycleState]]] = {
    (_STATE.UNCONFIGURED, "configure"): (_STATE.CONFIGURING, _STATE.INACTIVE),
    (_STATE.INACTIVE, "cleanup"): (_STATE.CLEANINGUP, _STATE.UNCONFIGURED),
    (_STATE.INACTIVE, "activate"): (_STATE.ACTIVATING, _STATE.ACTIVE),
    (_STATE.ACTIVE, "deactivate"): (_STATE.DEACTIVATING, _STATE.INACTIVE),
    (_STATE.UNCONFIGURED, "shutdown"): (_STATE.SHUTTINGDOWN, _STATE.FINALIZED),
    (_STATE.INACTIVE, "shutdown"): (_STATE.SHUTTINGDOWN, _STATE.FINALIZED),
    (_STATE.ACTIVE, "shutdown"): (_STATE.SHUTTINGDOWN, _STATE.FINALIZED),
}


class Lifecycle:
    """The state of one node; thread-safe.

    Usage::

        with lifecycle.transition("configure"):
            open_everything()  # an exception leads through error processing back to unconfigured

        lifecycle.trigger("activate")  # a transition without work
    """

    def __init__(self, on_change: Callable[[LifecycleState, LifecycleState], None] | None = None) -> None:
        """Start unconfigured.

        Args:
            on_change: called with the old and the new state after every change, in the thread that made it.
        """
        self._lock = threading.Lock()
        self._state = LifecycleState.UNCONFIGURED
        self._on_change = on_change

    @property
    def state(self) -> LifecycleState:
        """The state now."""
        return self._state

    @property
    def allowed(self) -> tuple[Transition, ...]:
        """Transitions that this state allows."""
        return tuple(name for name in get_args(Transition) if (self._state, name) in _TABLE)

    def trigger(self, transition: Transition) -> LifecycleState:
        """Make a transition and return the new state.

        Raises:
            LifecycleError: this state does not allow it; the message names those that it allows.
        """
        with self.transition(transition):
            pass
        return self._state

    @contextmanager
    def transition(self, transition: Transition) -> Iterator[None]:
        """Be in the transition's own state inside the `with`, and in its goal state after it.

        An exception inside leads through `errorprocessing` to `unconfigured` (after a shutdown to `finalized`)
        and is raised again.

        Raises:
            LifecycleError: this state does not allow it.
        """
        with self._lock:
            try:
                during, after = _TABLE[self._state, transition]
            except KeyError:
                allowed = ", ".join(self.allowed) or "none"
                raise LifecycleError(
                    f"transition {transition!r} is not allowed in state {self._state.label}: allowed there: {allowed}"
                ) from None
            before, self._state = self._state, during
        self._tell(before, during)
        try:
            yield
        except BaseException:
            self._move(LifecycleState.ERRORPROCESSING)
            self._move(LifecycleState.FINALIZED if transition == "shutdown" else LifecycleState.UNCONFIGURED)
            raise
        self._move(after)

    def _move(self, state: LifecycleState) -> None:
        with self._lock:
            before, self._state = self._state, state
        self._tell(before, state)

    def _tell(self, before: LifecycleState, after: LifecycleState) -> None:
        if self._on_change is not None:
            self._on_change(before, after)
