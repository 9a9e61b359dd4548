"""What an actor tells Prometheus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from actors.worker import Worker
from common.messages.stats import ActorStats
from common.system.metrics_server import Figure, MetricsServer

_FIGURES: Final[dict[str, tuple[str, Callable[[ActorStats], float]]]] = {
    "hd_collector_steps_per_second": ("Decisions per second of late.", lambda s: s.steps_per_second),
    "hd_collector_policy_version": ("Policy version in use, -1 before the first.", lambda s: s.version),
    "hd_collector_policy_age_seconds": ("Seconds since that version came.", lambda s: s.version_age),
    "hd_collector_buffered_messages": ("Messages that wait for an acknowledgement.", lambda s: s.buffered),
}


def serve_figures(address: tuple[str, int], worker: Worker) -> MetricsServer:
    """Serve the figures of an actor at this host and port."""
    return MetricsServer(address, lambda: actor_figures(worker.stats))


def actor_figures(stats: ActorStats | None) -> Iterator[Figure]:
    """Return the figures of an actor; of one that has not joined its run yet, only that it is there."""
    yield Figure("hd_collector_joined", "Whether the actor has joined its run.", {(): float(stats is not None)})
    if stats is None:
        return
    labels, values = ("actor", "host"), (stats.actor, stats.host)
    yield Figure(
        "hd_collector_steps", "Decisions since the actor started.", {values: float(stats.steps)}, labels, "counter"
    )
    yield Figure(
        "hd_collector_episodes", "Episodes since the actor started.", {values: float(stats.episodes)}, labels, "counter"
    )
    for name, (text, value) in _FIGURES.items():
        yield Figure(name, text, {values: float(value(stats))}, labels)
