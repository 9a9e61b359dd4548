"""Procedural worlds: one generator a file, found by name."""

from __future__ import annotations

from difflib import get_close_matches

from pydantic import ValidationError

from actors.maps.generators.base import Generator
from actors.maps.generators.building import Building
from actors.maps.generators.forest import Forest
from actors.maps.generators.hall import Hall
from actors.maps.generators.office import Office
from actors.maps.generators.rooms import Rooms
from actors.maps.generators.tunnel import Tunnel
from actors.maps.generators.warehouse import Warehouse
from common.errors import MapError

__all__ = ["GENERATORS", "Generator", "make_generator", "warm_up"]

GENERATORS: dict[str, type[Generator]] = {
    kind.kind: kind for kind in (Rooms, Office, Warehouse, Forest, Tunnel, Hall, Building)
}


def make_generator(name: str, parameters: dict[str, str]) -> Generator:
    """Make a generator from its name and its parameters as text.

    Args:
        name: a key of `GENERATORS`.
        parameters: values by parameter name, as written in a specification.

    Returns:
        The generator.

    Raises:
        MapError: unknown name or parameter, or a value of the wrong type or outside its range.
    """
    kind = GENERATORS.get(name)
    if kind is None:
        raise MapError(f"unknown generator '{name}'{_hint(name, list(GENERATORS))}: choose one of {_list(GENERATORS)}")
    unknown = [key for key in parameters if key not in kind.model_fields]
    if unknown:
        raise MapError(
            f"generator:{name}: unknown parameter '{unknown[0]}'{_hint(unknown[0], list(kind.model_fields))}: choose "
            f"from {_list(kind.model_fields)}"
        )
    try:
        return kind.model_validate_strings(parameters)
    except ValidationError as error:
        problems = []
        for problem in error.errors(include_url=False):
            field = ".".join(str(part) for part in problem["loc"])
            given = f", got '{parameters[field]}'" if field in parameters else ""
            problems.append(f"{field + ': ' if field else ''}{problem['msg']}{given}")
        raise MapError(f"generator:{name}: {'; '.join(problems)}") from error


def warm_up() -> None:
    """Compile all kernels of generators, or load them from numba's cache, before processes start."""
    for name in GENERATORS:
        make_generator(name, {"width": "192", "height": "192"}).world(0)


def _list(names: object) -> str:
    return ", ".join(sorted(names))  # type: ignore[call-overload]


def _hint(name: str, known: list[str]) -> str:
    close = get_close_matches(name, known, n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""
