"""What the bridge tells about itself: one record, sent as JSON and answered to every command."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from common.planners.base import Position
from deploy.bridge.outcome import Outcome
from deploy.bridge.unseen import Unseen
from deploy.safety.gate_state import GateMode, GateState

VERSION = 1


@dataclass(frozen=True, slots=True)
class Policy:
    """Which trained policy decides.

    Attributes:
        run: name of the training run.
        version: policy version.
        live: it follows a learner.
    """

    run: str
    version: int
    live: bool


@dataclass(frozen=True, slots=True)
class Problem:
    """A warning or an error.

    Attributes:
        text: what went wrong.
        age: seconds ago.
    """

    text: str
    age: float


@dataclass(frozen=True, slots=True)
class Status:
    """The state of a bridge at one moment; lengths in metres, times in seconds, positions in the map frame.

    Attributes:
        name: of the robot.
        instance: of the bridge's process; a bridge that is started anew has another one.
        lifecycle: state by the names of ROS 2: unconfigured, inactive, active, finalized, or one on the way.
        state: idle, running, paused, returning, finished, failed or aborted, by the orders; `holding` when something
            holds a robot that was told to move.
        reason: why it is in this state, in words.
        task: exploration or navigation.
        planner: in charge at this moment.
        relieved: why the fallback is in charge; empty while it is not.
        guard: name of the classical planner to which the policy's guard left the last decision; empty without.
        policy: the trained policy, None with other planners.
        faults: all that is wrong with the inputs, by kind.
        checks: checks in a row that found nothing left to do.
        bans: number of places that are left alone for a while.
        pose: x, y and yaw (radians).
        waypoint: where it goes next.
        beacon: the area it is on its way to.
        target: of navigation.
        home: where the task began.
        explored_area: known free area, square metres.
        distance: travelled.
        duration: since the first motion.
        decision_seconds: time of the last decision, the refreshed map included.
        decision_p95: 95 % of the last 200 decisions took no longer.
        viewpoints: reachable viewpoints.
        frontiers: frontier cells.
        unseen: what an exploration that has ended left at the edge of what the robot can reach; None for nothing.
        beacons: beacons.
        ages: since the last message of each input.
        scans: that went into the map.
        dropped: messages that did not, by reason.
        gate: what the watchdog does with the velocity topic.
        gate_reason: why.
        emergency_stop: the stop is latched.
        error: the last warning or error that is not over, None without; what merely happened is over after a minute.
        version: of this record.
    """

    name: str
    instance: str
    lifecycle: str
    state: str
    reason: str
    task: str
    planner: str
    relieved: str
    guard: str
    policy: Policy | None
    faults: dict[str, str]
    checks: int
    bans: int
    pose: tuple[float, float, float] | None
    waypoint: Position | None
    beacon: Position | None
    target: Position | None
    home: Position | None
    explored_area: float
    distance: float
    duration: float
    decision_seconds: float
    decision_p95: float
    viewpoints: int
    frontiers: int
    unseen: Unseen | None
    beacons: int
    ages: dict[str, float]
    scans: int
    dropped: dict[str, int]
    gate: str
    gate_reason: str
    emergency_stop: bool
    error: Problem | None = None
    version: int = field(default=VERSION)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values, numbers rounded to what matters."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def state_of(outcome: Outcome, gate: GateState) -> tuple[str, str]:
    """Return the state and the reason for it, of which the most pressing counts.

    Args:
        outcome: of the last pass of the decision loop.
        gate: what the watchdog says.
    """
    orders = outcome.orders
    if gate.emergency_stop or gate.overridden:
        return "holding" if orders.moving else orders.phase.value, gate.reason
    if not orders.moving:
        return orders.phase.value, orders.reason
    if outcome.hold:
        return "holding", outcome.hold
    # A gate that is merely held is held by this bridge, which says itself why.
    if not gate.clear and not (gate.alive and gate.mode is GateMode.HELD):
        return "holding", gate.reason
    course = outcome.course
    return orders.phase.value, course.reason if course is not None and course.reason else orders.reason


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value
