"""Registries of what only actors have: simulators and generators of worlds.

They are here, as names, because configurations are written and checked on machines that simulate nothing. The classes
themselves are imported in `actors`, when one is asked for.
"""

from __future__ import annotations

from typing import Final

from common.errors import MapError
from common.registry import Entry, Registry

GENERATOR_PREFIX: Final = "generator:"
"""Sources of worlds that begin so name a generator: ``generator:NAME[?key=value&...]``."""

SIMULATORS: Final = Registry(
    "simulator",
    "hdplanner.simulators",
    {
        "pybullet": Entry("actors.simulators.factory:make_pybullet", "a physics world of wall meshes"),
        "grid": Entry("actors.simulators.factory:make_grid", "exact 2D ray traversal, without physics"),
    },
)
"""Simulators: called with a `SimulatorConfig` and the sensor's range in metres, each returns an
`actors.simulators.base.Simulator`."""

GENERATORS: Final = Registry(
    "generator",
    "hdplanner.generators",
    {
        "rooms": Entry("actors.maps.generators.rooms:Rooms", "rooms and corridors, as the public maps"),
        "office": Entry("actors.maps.generators.office:Office", "offices along corridors"),
        "warehouse": Entry("actors.maps.generators.warehouse:Warehouse", "rows of shelves"),
        "forest": Entry("actors.maps.generators.forest:Forest", "trees in the open"),
        "tunnel": Entry("actors.maps.generators.tunnel:Tunnel", "winding tunnels"),
        "hall": Entry("actors.maps.generators.hall:Hall", "an indoor hall of 130 m x 100 m"),
        "building": Entry("actors.maps.generators.building:Building", "a large building"),
    },
    MapError,
)
"""Generators of worlds: subclasses of `actors.maps.generators.base.Generator`."""


def generator_name(source: str) -> str | None:
    """Return the name of the generator that a source of worlds names; None for files."""
    if not source.startswith(GENERATOR_PREFIX):
        return None
    return source.removeprefix(GENERATOR_PREFIX).partition("?")[0]
