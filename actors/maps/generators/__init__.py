"""Procedural worlds: one generator a file, found by name."""

from __future__ import annotations

from pydantic import ValidationError

from actors.maps.generators.base import Generator
from common.errors import MapError
from common.extensions import GENERATORS
from common.problems import problems
from common.registry import did_you_mean

__all__ = ["Generator", "find_generator", "make_generator", "warm_up"]


def find_generator(name: str) -> type[Generator]:
    """Return the class of a generator by its name, or by MODULE:CLASS; MapError when there is none."""
    kind = GENERATORS.load(name)
    if not (isinstance(kind, type) and issubclass(kind, Generator)):
        raise MapError(f"{name!r} is no generator: expected a subclass of actors.maps.generators.base.Generator")
    return kind


def make_generator(name: str, parameters: dict[str, str]) -> Generator:
    """Make a generator from its name and its parameters as text.

    Args:
        name: as in a specification.
        parameters: values by parameter name, as written there.

    Returns:
        The generator.

    Raises:
        MapError: unknown name or parameter, or a value of the wrong type or outside its range.
    """
    kind = find_generator(name)
    known = list(kind.model_fields)
    unknown = [key for key in parameters if key not in known]
    if unknown:
        raise MapError(
            f"generator:{name}: unknown parameter {unknown[0]!r}{did_you_mean(unknown[0], known)}: choose from "
            f"{', '.join(sorted(known))}"
        )
    try:
        return kind.model_validate_strings(parameters)
    except ValidationError as error:
        wrong = []
        for problem in problems(error):
            given = f", got '{parameters[problem.path]}'" if problem.path in parameters else ""
            wrong.append(f"{problem.path + ': ' if problem.path else ''}{problem.words}{given}")
        raise MapError(f"generator:{name}: {'; '.join(wrong)}") from error


def warm_up() -> None:
    """Compile all kernels of shipped generators, or load them from numba's cache, before processes start."""
    for name in GENERATORS.shipped:
        make_generator(name, {"width": "192", "height": "192"}).world(0)
