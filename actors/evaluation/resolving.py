"""The settings of an evaluation, made from the options of its command."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import ValidationError

from actors.evaluation.results import Results
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.suited import suited_config
from actors.evaluation.worlds import WorldSet
from actors.maps.spec import with_places
from common.errors import ConfigError
from common.policies.shipped import policy_path
from common.problems import first_problem


def resolve(
    maps: Sequence[str],
    limit: int | None,
    config: Path | None,
    overrides: Sequence[str] | None,
    *,
    start: tuple[float, float] | None = None,
    target: tuple[float, float] | None = None,
    task: str | None = None,
    simulator: str = "grid",
    fidelity: str | None = None,
    metres_per_pixel: float | None = None,
    seed: int = 0,
    time_limit: float = 10.0,
    policy: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> EvaluationSettings:
    """Return the settings of an evaluation: those that suit the maps, configuration file, environment, simulator and
    task, ``--set``, then the command's other options; the later one wins.

    Args:
        maps: sources of worlds.
        limit: number of worlds.
        config: the file.
        overrides: values of ``--set``.
        start: puts the start into the only source, a file.
        target: likewise.
        task: name of the task.
        simulator: its name.
        fidelity: of the simulator.
        metres_per_pixel: scale of images.
        seed: of planners and simulator.
        time_limit: seconds for a decision.
        policy: file of the learned planner.
        tell: called with a line about the settings that suit the maps.

    Raises:
        ConfigError: a setting is unknown or out of range.
        MapError: a source cannot be used.
    """
    specs = with_places(list(maps), start, target)
    own = [f"simulator.name={simulator}"]
    if task is not None:
        own.append(f"task.name={task}")
    own += overrides or []
    if fidelity is not None:
        own.append(f"simulator.fidelity={fidelity}")
    if metres_per_pixel is not None:
        own.append(f"maps.metres_per_pixel={metres_per_pixel}")
    suited = suited_config(specs, config, own, os.environ)
    if tell is not None and suited.sentence:
        tell(suited.sentence)
    run = suited.run
    try:
        return EvaluationSettings(
            maps=tuple(specs),
            limit=limit,
            metres_per_pixel=WorldSet(suited.source, limit).metres_per_pixel,
            task=run.task,
            mapping=run.mapping,
            simulator=run.simulator,
            seed=seed,
            time_limit=time_limit,
            policy=None if policy is None else str(policy_path(policy).resolve()),
        )
    except ValidationError as error:
        first = first_problem(error)
        raise ConfigError(f"{first.path}: {first.words}, got {first.given!r}: correct it") from None


def settings_of(
    results: Results,
    maps: Sequence[str],
    limit: int | None,
    config: Path | None,
    overrides: Sequence[str] | None,
    start: tuple[float, float] | None = None,
    target: tuple[float, float] | None = None,
) -> tuple[EvaluationSettings, WorldSet]:
    """Return settings that suit a results file, and the worlds to find its maps in.

    Raises:
        ConfigError: a setting is unknown or out of range.
        MapError: a source cannot be used.
    """
    settings = resolve(
        maps,
        limit,
        config,
        overrides,
        start=start,
        target=target,
        task=results.task,
        metres_per_pixel=results.metres_per_pixel,
    )
    if settings.task.kind.name != results.task:
        raise ConfigError(
            f"the results are for the task {results.task}, but task.name is {settings.task.name}: leave it out"
        )
    return settings, WorldSet.open(settings.maps, results.task, results.metres_per_pixel, limit)
