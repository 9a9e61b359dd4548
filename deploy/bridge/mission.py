"""What the robot has been told to do, and how far it has come with it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from math import hypot, inf, isfinite
from typing import Final

from common.planners.base import Position, TaskName
from common.tasks import EXPLORATION, NAVIGATION, Task, find_task
from deploy.bridge.command_text import CommandError


class Phase(StrEnum):
    """What the robot does by its orders; whether something holds it meanwhile is another matter."""

    IDLE = "idle"
    """It waits for the command to start."""
    RUNNING = "running"
    """It explores, or goes to its target."""
    PAUSED = "paused"
    """It waits for the command to resume."""
    RETURNING = "returning"
    """It drives back to where the task began."""
    FINISHED = "finished"
    """The task is done."""
    FAILED = "failed"
    """The task cannot be done."""
    ABORTED = "aborted"
    """The task was ended by command."""


WAITS: Final = "waits for the command to start"
"""What a robot says that has no orders yet."""
MOVING = frozenset({Phase.RUNNING, Phase.RETURNING})
_ENDED = frozenset({Phase.FINISHED, Phase.FAILED, Phase.ABORTED})


@dataclass(frozen=True, slots=True)
class Orders:
    """The state of a mission; a new one for every change.

    Attributes:
        phase: what the robot does.
        reason: why, in words for the operator.
        task: of this moment; an exploration may be left for a target, and taken up again.
        target: of the navigation task, (x, y) in the map frame, metres.
        home: where the task began, or None before the start.
        episode: rises when a planner must begin anew: at a start, a new target, a reset, and on the way home.
        map_resets: how often the map was to be forgotten.
        paused: the phase that a resume goes back to.
    """

    phase: Phase = Phase.IDLE
    reason: str = WAITS
    task: Task = EXPLORATION
    target: Position | None = None
    home: Position | None = None
    episode: int = 0
    map_resets: int = 0
    paused: Phase = Phase.IDLE

    @property
    def moving(self) -> bool:
        """Whether the robot shall move."""
        return self.phase in MOVING

    @property
    def purpose(self) -> Phase:
        """What the robot does, or goes on with after a pause."""
        return self.paused if self.phase is Phase.PAUSED else self.phase


class Mission:
    """Carries out commands on the orders; every method may be called from any thread and returns at once.

    Usage::

        mission = Mission("exploration")
        mission.start()
        while mission.orders.moving: ...
    """

    def __init__(
        self,
        task: TaskName,
        target: Position | None = None,
        reach: float = inf,
        here: Callable[[], Position | None] = lambda: None,
        permits: Callable[[Position], bool] = lambda _: True,
        waits: str = WAITS,
    ) -> None:
        """Begin idle.

        Args:
            task: name of the task that a start begins.
            target: when it is known already; a task without one has none.
            reach: farthest target from the robot, metres.
            here: returns where the robot is, map frame; None while that is not known.
            permits: whether the geofence lets the robot come near enough to a target.
            waits: what it waits for, in words for the operator.
        """
        self.task = find_task(task)
        self._reach = reach
        self._here = here
        self._permits = permits
        self._lock = threading.Lock()
        self._orders = Orders(reason=waits, task=self.task, target=target if self.task.needs_target else None)

    @property
    def orders(self) -> Orders:
        """The orders of this moment."""
        return self._orders

    def start(self) -> None:
        """Begin the task, or go on after a pause; while it runs already, or a target is on its way, nothing changes.

        After a target that was gone to in the midst of an exploration, the exploration continues.

        Raises:
            CommandError: the task has no target yet.
        """
        here = self._here()
        with self._lock:
            orders = self._orders
            if orders.phase is Phase.RUNNING:
                return
            if orders.phase is Phase.PAUSED:
                self._change(orders.paused, "resumed by command")
                return
            if self.task.needs_target and orders.target is None:
                raise CommandError("there is no target yet: send `goal X Y` first, or set decision.goal")
            if orders.phase in _ENDED:
                self._take_up_task()
            self._change(Phase.RUNNING, "started by command", new_episode=True)
            if here is not None:
                self._set_home(here)

    def pause(self) -> None:
        """Stop where the robot is, until `resume`.

        Raises:
            CommandError: nothing runs.
        """
        with self._lock:
            phase = self._orders.phase
            if phase is Phase.PAUSED:
                return
            if phase not in MOVING:
                raise CommandError(f"there is nothing to pause, the robot is {phase}: send `start` first")
            self._orders = replace(self._orders, paused=phase)
            self._change(Phase.PAUSED, "paused by command")

    def resume(self) -> None:
        """Go on after `pause`.

        Raises:
            CommandError: nothing is paused.
        """
        with self._lock:
            phase = self._orders.phase
            if phase in MOVING:
                return
            if phase is not Phase.PAUSED:
                raise CommandError(f"there is nothing to resume, the robot is {phase}: send `start`")
            self._change(self._orders.paused, "resumed by command")

    def abort(self) -> None:
        """End the task where the robot is; the map stays."""
        with self._lock:
            self._change(Phase.ABORTED, "aborted by command")

    def emergency_stop(self, reason: str) -> None:
        """End what the robot does, so that no release sets it in motion: only a new `start` does.

        Args:
            reason: why it stands, as the gate says it.
        """
        with self._lock:
            if self._orders.moving or self._orders.phase is Phase.PAUSED:
                self._change(Phase.ABORTED, f"{reason}: the robot stands until it is told to start")

    def released(self, who: str, why: str) -> None:
        """Note that somebody released the emergency stop, and why: what it ended waits for a start."""
        with self._lock:
            if self._orders.phase is Phase.ABORTED:
                text = f"emergency stop released by {who}: {why}: the robot stands until it is told to start"
                self._change(Phase.ABORTED, text)

    def wait_for_start(self) -> None:
        """Note that a robot that has done nothing yet does not start by itself any more."""
        with self._lock:
            if self._orders.phase is Phase.IDLE:
                self._change(Phase.IDLE, WAITS)

    def return_home(self, reason: str = "called home by command") -> None:
        """Drive to where the task began.

        Raises:
            CommandError: nobody knows where the task began.
        """
        with self._lock:
            if self._orders.home is None:
                raise CommandError(
                    "there is no home yet, it is where the robot is at `start`: send that, with its pose known"
                )
            if self._orders.phase is not Phase.RETURNING:
                self._change(Phase.RETURNING, reason, new_episode=True)

    def reset(self) -> None:
        """Forget the map and all that was decided; what the robot does continues with a new map."""
        with self._lock:
            orders = self._orders
            self._orders = replace(orders, map_resets=orders.map_resets + 1, episode=orders.episode + 1)

    def forget_home(self) -> None:
        """Forget where the task began, because odometry or SLAM began anew; what has to go to a known place ends."""
        with self._lock:
            self._orders = replace(self._orders, home=None)
            lost = self._orders.purpose is Phase.RETURNING or self._orders.task.needs_target
            if lost and (self._orders.moving or self._orders.phase is Phase.PAUSED):
                self._change(
                    Phase.ABORTED,
                    "odometry or SLAM began anew, so home and targets lie elsewhere now: send a new goal, or `start`",
                )

    def goal(self, target: Position) -> None:
        """Set a target; a robot under way goes there at once, one that waits does with `start`.

        An exploration is left for it, and taken up again by `explore`, or by `start` when the target is reached.

        Raises:
            CommandError: the target is not finite, too far away, or outside the geofence.
        """
        if not (isfinite(target[0]) and isfinite(target[1])):
            raise CommandError(f"a target must be two finite numbers in metres, got {target}")
        # Before the first pose, the frame's origin stands for the robot; the decision loop looks again when it begins.
        far = too_far(target, self._here() or (0.0, 0.0), self._reach)
        if far:
            raise CommandError(far)
        if not self._permits(target):
            raise CommandError(
                f"a target must lie inside the geofence (safety.geofence), ({target[0]:.6g}, {target[1]:.6g}) does "
                "not: send another one"
            )
        with self._lock:
            self._orders = replace(
                self._orders, task=self.task if self.task.needs_target else NAVIGATION, target=target
            )
            if self._orders.phase in {*MOVING, Phase.FINISHED, Phase.FAILED}:
                self._change(Phase.RUNNING, f"new target ({target[0]:.2f}, {target[1]:.2f})", new_episode=True)
            elif self._orders.phase is Phase.ABORTED and not self.task.needs_target:
                # The next start is meant for this target.
                self._change(Phase.IDLE, "has a new target, and waits for the command to start")
            elif self._orders.phase is Phase.PAUSED:
                self._orders = replace(self._orders, paused=Phase.RUNNING, episode=self._orders.episode + 1)

    def explore(self) -> None:
        """Leave the target and continue exploring; a robot that waits does so with `start`.

        Raises:
            CommandError: the task has a target.
        """
        if self.task.needs_target:
            raise CommandError("this bridge goes to targets: set decision.task=exploration and restart it")
        with self._lock:
            orders = self._orders
            if orders.phase is Phase.RUNNING and orders.task is self.task:
                return
            self._take_up_task()
            if orders.phase in {*MOVING, Phase.FINISHED, Phase.FAILED}:
                self._change(Phase.RUNNING, "explores by command", new_episode=True)
            elif orders.phase is Phase.PAUSED:
                self._orders = replace(self._orders, paused=Phase.RUNNING, episode=orders.episode + 1)

    def begun(self, here: Position) -> None:
        """Note where the robot is when it first decides, in case its pose was not known when the task was started."""
        with self._lock:
            self._set_home(here)

    def end(self, phase: Phase, reason: str, episode: int) -> None:
        """End the task of an episode; nothing happens when a command was quicker."""
        with self._lock:
            if self._orders.episode == episode and self._orders.moving:
                self._change(phase, reason)

    def _set_home(self, here: Position) -> None:
        if self._orders.home is None:
            self._orders = replace(self._orders, home=here)

    def _take_up_task(self) -> None:
        if not self.task.needs_target:
            self._orders = replace(self._orders, task=self.task, target=None)

    def _change(self, phase: Phase, reason: str, *, new_episode: bool = False) -> None:
        episode = self._orders.episode + int(new_episode)
        self._orders = replace(self._orders, phase=phase, reason=reason, episode=episode)


def too_far(target: Position, here: Position, reach: float) -> str:
    """Say in one sentence that a target lies farther from the robot than it may; empty when it does not."""
    distance = hypot(target[0] - here[0], target[1] - here[1])
    if distance <= reach:
        return ""
    return (
        f"a target must be within {reach:g} m of the robot (decision.goal_reach), in metres of the map frame and not "
        f"in degrees or UTM coordinates; ({target[0]:.6g}, {target[1]:.6g}) is {distance:.6g} m from "
        f"({here[0]:.2f}, {here[1]:.2f})"
    )
