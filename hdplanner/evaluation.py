"""An evaluation in this process, for scripts and tests; `hd-eval run` does it in several, with results files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from actors.evaluation.episode import tell_nobody
from actors.evaluation.resolving import resolve
from actors.evaluation.results import EpisodeResult
from actors.evaluation.worker import Worker
from common.config import MappingConfig
from common.planners.base import Planner


def evaluate(
    planner: str | Callable[[MappingConfig], Planner],
    maps: Sequence[str] = ("generator:rooms",),
    *,
    count: int | None = 10,
    task: str = "exploration",
    simulator: str = "grid",
    policy: str | Path | None = None,
    seed: int = 0,
    settings: Sequence[str] = (),
) -> list[EpisodeResult]:
    """Run a planner in worlds, by the protocol and with the settings of `hd-eval run`.

    Args:
        planner: a name, MODULE:CLASS, or what makes a planner of a `MappingConfig`, such as its class.
        maps: folders of maps, map files, or `generator:NAME[?key=value&...]`.
        count: worlds, spread evenly; None for all of a folder, or 100 of a generator.
        task: a name, or MODULE:NAME.
        simulator: a name, or MODULE:CLASS.
        policy: weights of `hdplanner`; the ones that ship when not given.
        seed: of planner and simulator.
        settings: changes of single settings, ``section.field=value``.

    Returns:
        One result for each world, in their order.

    Raises:
        HDError: a name or a setting is unknown, a world does not suit, or the planner broke the rules of the protocol.
    """
    chosen = resolve(
        maps,
        count,
        None,
        settings,
        task=task,
        simulator=simulator,
        seed=seed,
        policy=None if policy is None else Path(policy),
    )
    made = chosen.make(planner) if isinstance(planner, str) else planner(chosen.mapping)
    chosen.asked_of(made)
    worker = Worker(chosen, tell_nobody)
    try:
        worlds = worker.worlds
        worker.warm_up(made)
        return [worker.attempt(made, number).result(worlds.name(number)) for number in worlds.numbers]
    finally:
        worker.close()
