"""The names in a run's configuration that stand for code, and the door for configurations that come from the bus."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator

from pydantic import ValidationError

from common.config.run import RunConfig
from common.errors import MessageError
from common.extensions import GENERATORS, SIMULATORS, generator_name
from common.problems import first_problem
from common.registry import NamedPart, refuse_modules
from common.system.printable import printable
from common.tasks import TASKS


def named_parts(config: RunConfig) -> Iterator[NamedPart]:
    """Yield every simulator, task and generator that a run's configuration names."""
    yield NamedPart("simulator.name", SIMULATORS, config.simulator.name)
    yield NamedPart("task.name", TASKS, config.task.name)
    maps = config.maps
    yield from generators_of("maps.train", maps.train)
    yield from generators_of("maps.validation", maps.validation)
    yield from generators_of("maps.train_navigation", maps.train_navigation)
    yield from generators_of("maps.validation_navigation", maps.validation_navigation)
    for number, family in enumerate(config.families):
        for task in family.tasks:
            yield NamedPart(f"families.{number}.tasks", TASKS, task)
        yield from generators_of(f"families.{number}.train", family.train)
        yield from generators_of(f"families.{number}.validation", family.validation)


def generators_of(path: str, sources: Iterable[str]) -> Iterator[NamedPart]:
    """Yield the generators that sources of worlds name; `path` is the setting that holds them."""
    for source in sources:
        name = generator_name(source)
        if name is not None:
            yield NamedPart(path, GENERATORS, name)


def module_names(config: RunConfig) -> list[str]:
    """Return each MODULE:CLASS that a run's configuration names, once."""
    return list(dict.fromkeys(part.name for part in named_parts(config) if ":" in part.name))


def config_from_message(
    text: str,
    allowed: Collection[str],
    remedy: str,
    change: Callable[[RunConfig], RunConfig] = lambda config: config,
) -> RunConfig:
    """Read a run's configuration that came over the bus. Everything that does so comes through here.

    A message must not decide which code this machine loads, so MODULE:CLASS stands only for what its user has named.

    Args:
        text: JSON, as the run's specification has it.
        allowed: each MODULE:CLASS that the user of this machine has named.
        remedy: how that user names one, for the message.
        change: puts in what this machine does otherwise, before the names are looked at.

    Raises:
        MessageError: it is not a configuration that this version knows.
        ConfigError: it names a module that is not allowed.
    """
    try:
        config = RunConfig.model_validate_json(text)
    except ValidationError as error:
        first = first_problem(error)
        where = first.path or "the whole"
        raise MessageError(
            "spec.config",
            printable(
                f"is not a configuration of this version ({where[:100]}: {first.words}): use the same version on all "
                "machines"
            ),
        ) from None
    config = change(config)
    refuse_modules(named_parts(config), allowed, f"the learner of run {config.name!r}", remedy)
    return config
