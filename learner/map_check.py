"""Looks at the sources of maps before a run begins: a typo should end the start, not every actor later."""

from __future__ import annotations

import logging
import subprocess

from common.config import MapsConfig, RunConfig
from common.errors import ConfigError
from common.extensions import GENERATOR_PREFIX
from common.system.runtime import python_module

logger = logging.getLogger(__name__)

_SECONDS = 120.0
_MARK = "error: "


def check_maps(config: RunConfig, *, elsewhere: bool = False) -> None:
    """Open every source of training and validation worlds once.

    That is the actors' business, whose code the learner does not import: the command `python -m actors.maps check` does
    it in a process of its own.

    Args:
        config: of the run.
        elsewhere: maps lie on the actors' machines, so only generators are looked at.

    Raises:
        ConfigError: a source cannot be used, or there is none to train in.
    """
    _tell_of_other_worlds(config)
    for task in config.tasks:
        families = [family for family in config.mix if family.serves(task.name)]
        for family in families:
            if not config.sources(family, task.name, evaluate=False):
                raise ConfigError(
                    f"there are no worlds to train {task.name} in"
                    + (f" for the family {family.name!r}: set its `train`, or" if config.families else ": set")
                    + " maps.train, such as --set maps.train=generator:rooms"
                )
        specs = [
            source
            for evaluate in (False, True)
            for family in families
            for source in config.sources(family, task.name, evaluate=evaluate)
        ]
        _check(
            [spec for spec in dict.fromkeys(specs) if spec.startswith(GENERATOR_PREFIX) or not elsewhere],
            task.name,
            config,
        )


def _tell_of_other_worlds(config: RunConfig) -> None:
    """Warn where evaluators are left with the default worlds, which are not of the kind that the run trains in."""
    default = MapsConfig().validation
    kinds = {source.partition("?")[0] for source in config.maps.train}
    if config.families or config.maps.validation != default or kinds & {source.partition("?")[0] for source in default}:
        return
    generated = sorted(kind for kind in kinds if kind.startswith(GENERATOR_PREFIX))
    logger.warning(
        "the run trains in %s, and evaluators choose its best policy in %s: set maps.validation to worlds of the same "
        "kind, such as %s",
        ", ".join(config.maps.train),
        ", ".join(default),
        f"{generated[0]}?seed=1000000" if generated else "FOLDER#validation",
    )


def _check(specs: list[str], task: str, config: RunConfig) -> None:
    if not specs:
        return
    command = python_module("actors.maps", "check", "--task", task)
    if config.maps.metres_per_pixel is not None:
        command += ["--scale", str(config.maps.metres_per_pixel)]
    try:
        done = subprocess.run(
            [*command, "--", *specs],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        logger.warning(
            "the maps could not be checked within %g s, so the run starts unchecked: actors name a source that they "
            "cannot use",
            _SECONDS,
        )
        return
    if done.returncode == 0:
        return
    said = [line for line in done.stderr.splitlines() if line.strip()]
    problem = next((line.removeprefix(_MARK) for line in said if line.startswith(_MARK)), None)
    if problem is None:
        # The check itself failed, for example without the packages that actors need.
        logger.warning("the maps could not be looked at here: %s", said[-1] if said else "the check said nothing")
        return
    raise ConfigError(
        f"maps of the run: {problem}. If the maps exist only on the actors' machines, add --maps-elsewhere"
    )


def has_validation(config: RunConfig) -> bool:
    """Whether there are worlds for evaluators."""
    return any(
        config.sources(family, task.name, evaluate=True)
        for task in config.tasks
        for family in config.mix
        if family.serves(task.name)
    )
