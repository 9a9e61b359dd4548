"""A run's configuration with the settings that suit its sources of worlds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from actors.evaluation.step_limit import step_limit
from actors.maps.recommended import AUTO, MAX_STEPS, joined
from actors.maps.sources import MapSource, fixed_numbers, open_sources, recommended
from common.config import RunConfig
from common.config.load import load_config

# Worlds that decide on a step limit; always the same ones, so that the number of worlds of an evaluation plays no part.
_SAMPLE = 8


@dataclass(frozen=True, slots=True, eq=False)
class Suited:
    """What is configured, and where it came from.

    Attributes:
        run: the configuration.
        source: the worlds.
        names: of the presets, and paths of the files, that recommend settings.
        taken: the recommended settings that hold, by path; those that the user gives are left out.
    """

    run: RunConfig
    source: MapSource
    names: tuple[str, ...]
    taken: Mapping[str, Any]

    @property
    def sentence(self) -> str:
        """A line with the settings in effect; empty where nothing is recommended."""
        if not self.taken:
            return ""
        settings = " ".join(f"{path}={value}" for path, value in self.taken.items())
        return f"settings of {', '.join(self.names)}: {settings} (--set changes them)"


def suited_config(
    specs: Sequence[str],
    file: Path | None,
    overrides: Sequence[str],
    environment: Mapping[str, str],
    *,
    map_task: str | None = None,
) -> Suited:
    """Resolve a configuration; what file, environment and command line leave open is as the sources recommend.

    Args:
        specs: sources of worlds.
        file: TOML or JSON file.
        overrides: ``section.field=value`` texts.
        environment: variables.
        map_task: name of the task that maps have to suit; that of the configuration when not given.

    Raises:
        ConfigError: a setting is unknown or out of range, or sources need different ones.
        MapError: a source cannot be used.
    """
    given = _given(load_config(file, overrides, environment))
    suits = [recommended(spec) for spec in specs]
    taken = {path: value for path, value in joined(suits, given).items() if path not in given}
    plain = [f"{path}={json.dumps(value)}" for path, value in taken.items() if value != AUTO]
    run = load_config(file, [*plain, *overrides], environment)
    source = open_sources(specs, run.maps.metres_per_pixel, map_task or run.task.name)
    if taken.get(MAX_STEPS) == AUTO:
        steps = step_limit((source.world(number) for number in fixed_numbers(source, _SAMPLE)), run.mapping)
        taken[MAX_STEPS] = steps
        run = run.model_copy(update={"task": run.task.model_copy(update={"max_steps": steps})})
    names = tuple(dict.fromkeys(each.name for each in suits if each.settings))
    return Suited(run, source, names, taken)


def _given(run: RunConfig) -> list[str]:
    """Return the paths of the settings that somebody gave."""
    paths = []
    for section in run.model_fields_set:
        values = getattr(run, section)
        if isinstance(values, BaseModel):
            paths += [f"{section}.{name}" for name in values.model_fields_set]
    return paths
