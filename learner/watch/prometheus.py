"""What the learner tells Prometheus: itself, and each actor as it sees it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from common.system.metrics_server import Figure, Values
from learner.watch.status import ActorStatus, LearnerStatus

STATES: Final = (
    "collecting",
    "cloning",
    "training",
    "waiting",
    "paused",
    "disk full",
    "held",
    "stopping",
    "complete",
)

_COUNTERS: Final[dict[str, tuple[str, Callable[[LearnerStatus], float]]]] = {
    "hd_steps": ("Decisions collected since the run began.", lambda s: s.steps),
    "hd_episodes": ("Episodes finished since the run began.", lambda s: s.episodes),
    "hd_updates": ("Updates made since the run began.", lambda s: s.updates),
    "hd_refused_messages": ("Invalid messages since this learner started.", lambda s: s.refused),
}
_GAUGES: Final[dict[str, tuple[str, Callable[[LearnerStatus], float]]]] = {
    "hd_goal_updates": ("Updates after which the run is complete.", lambda s: s.total_updates),
    "hd_steps_per_second": ("Decisions collected per second of late.", lambda s: s.steps_per_second),
    "hd_updates_per_second": ("Updates per second of late.", lambda s: s.updates_per_second),
    "hd_policy_version": ("Newest published policy version.", lambda s: s.version),
    "hd_best_version": ("Version of the best evaluated policy, -1 before the first.", lambda s: s.best),
    "hd_replay_transitions": ("Transitions in the replay buffer.", lambda s: s.replay),
    "hd_replay_bytes": ("Memory of the replay buffer.", lambda s: s.replay_bytes),
    "hd_replay_fill": ("Share of the replay buffer's limit in use.", lambda s: s.replay_fill),
    "hd_ratio_declared": ("Declared updates per collected step.", lambda s: s.ratio_declared),
    "hd_ratio_actual": ("Updates per collected step so far.", lambda s: s.ratio_actual),
    "hd_ratio_lead_steps": ("Collected steps that wait for their updates.", lambda s: s.ratio_lead),
    "hd_hold_seconds": ("Seconds that actors are asked to pause.", lambda s: s.hold),
    "hd_next_checkpoint_seconds": ("Seconds until the next checkpoint.", lambda s: s.next_checkpoint),
    "hd_uptime_seconds": ("Seconds since this learner started.", lambda s: s.uptime),
}
_OF_ACTORS: Final[dict[str, tuple[str, Callable[[ActorStatus], float]]]] = {
    "hd_actor_steps_per_second": ("Decisions per second of an actor, of late.", lambda a: a.steps_per_second),
    "hd_actor_stored_steps": ("Decisions of an actor stored since this learner started.", lambda a: a.steps),
    "hd_actor_lag_versions": ("Policy versions that an actor is behind.", lambda a: a.lag),
    "hd_actor_lag_seconds": ("Seconds since an actor's version was no longer the newest.", lambda a: a.lag_seconds),
    "hd_actor_buffered_messages": ("Messages of an actor that wait for an acknowledgement.", lambda a: a.buffered),
    "hd_actor_silent_seconds": ("Seconds since an actor's last delivery.", lambda a: a.silent),
}


def learner_figures(status: LearnerStatus) -> Iterator[Figure]:
    """Return the figures of a learner and of the actors that are there."""
    for name, (text, value) in _COUNTERS.items():
        yield Figure(name, text, {(): float(value(status))}, kind="counter")
    for name, (text, value) in _GAUGES.items():
        yield Figure(name, text, {(): float(value(status))})
    states: Values = {(state,): float(state == status.state) for state in STATES}
    yield Figure("hd_state", "What the learner does: 1 for its state, 0 for all others.", states, ("state",))
    present = [actor for actor in status.actors if actor.alive]
    roles: Values = {(role,): float(sum(actor.role == role for actor in present)) for role in ("actor", "evaluator")}
    yield Figure("hd_actors", "Actors and evaluators on the bus.", roles, ("role",))
    yield Figure("hd_demand_actors", "Actors that would keep the learner busy.", {(): demand(status)})
    for name, (text, of_actor) in _OF_ACTORS.items():
        values: Values = {(actor.name, actor.role): float(of_actor(actor)) for actor in present}
        yield Figure(name, text, values, ("actor", "role"))
    success: Values = {(group,): means.success for group, means in status.late.items()}
    yield Figure("hd_episode_success", "Share of the late episodes that were completed.", success, ("group",))
    distance: Values = {(group,): means.distance for group, means in status.late.items()}
    yield Figure("hd_episode_distance_metres", "Mean way of the late episodes.", distance, ("group",))


def demand(status: LearnerStatus) -> float:
    """Return how many actors would keep this learner busy, for an autoscaler; at least 1.

    One more than there are while the learner waits for steps, fewer while actors are held, by the ratio of what it can
    use to what comes.
    """
    there = sum(actor.alive and actor.role == "actor" for actor in status.actors)
    if status.hold > 0.0 and status.steps_per_second > 0.0:
        wanted = status.updates_per_second / status.ratio_declared
        return max(1.0, min(float(there), there * wanted / status.steps_per_second))
    if status.state in ("collecting", "waiting"):
        return there + 1.0
    return max(1.0, float(there))
