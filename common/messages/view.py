"""An actor's episode at one moment, for people who look at it: bounded, and sent only while somebody does."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.messages.fields import Fields
from common.messages.places import USEFUL

MAX_CELLS: Final = 1 << 20
"""Cells of the belief at most: whoever sends makes a larger one coarser."""
MAX_VIEWPOINTS: Final = 4_000
MAX_EDGES: Final = 20_000
MAX_PLACES: Final = 4_000
"""Positions of each other kind at most."""
_MAX_SIDE: Final = 1 << 16
_MAX_METRES: Final = 1e6
# A belief of equal cells shrinks to a thousandth; whatever promises more is no belief.
_MAX_PACKED: Final = 1 << 19

Places = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeView:
    """What an actor knows and chose. All positions are metres in the map frame, float32, shape (n, 2).

    Attributes:
        actor: name of the actor.
        family: name of the family of worlds.
        world: name of the world.
        task: name of the task.
        driver: ``policy``, ``expert`` or ``random``.
        version: policy version, -1 without one.
        step: decisions so far.
        distance: travelled metres.
        explored: share of the reachable free area that was seen, 0 to 1.
        ended: the episode is over, and this is how it ended.
        success: the task is complete.
        resolution: metres per cell.
        origin: lower left corner of the first cell, metres.
        cells: the belief, -1 unknown, 0 free, 100 occupied, int8, shape (rows, columns), y up.
        viewpoints: of the graph.
        kinds: of each viewpoint, as `common.messages.places` has them, uint8, shape (n,).
        edges: pairs of viewpoints, uint16, shape (m, 2).
        frontiers: centres of frontier cells, some of them where there are many.
        beacons: all beacons.
        way: driven so far, the robot's place last.
        beacon: the chosen one, shape (0, 2) or (1, 2).
        waypoint: where the robot goes next, likewise.
        target: of navigation, likewise.
    """

    actor: str
    family: str
    world: str
    task: str
    driver: str
    version: int
    step: int
    distance: float
    explored: float
    ended: bool
    success: bool
    resolution: float
    origin: tuple[float, float]
    cells: NDArray[np.int8]
    viewpoints: Places
    kinds: NDArray[np.uint8]
    edges: NDArray[np.uint16]
    frontiers: Places
    beacons: Places
    way: Places
    beacon: Places
    waypoint: Places
    target: Places


_PLACES: Final = ("frontiers", "beacons", "way")
_SINGLE: Final = ("beacon", "waypoint", "target")


def view_fields(view: EpisodeView) -> dict[str, Any]:
    """Return the fields of a view as they travel: the belief is packed by zlib."""
    rows, columns = view.cells.shape
    packed = zlib.compress(np.ascontiguousarray(view.cells).tobytes(), 1)
    plain = (
        *("actor", "family", "world", "task", "driver", "version", "step", "ended", "success"),
        *("viewpoints", "kinds", "edges", *_PLACES, *_SINGLE),
    )
    return {
        **{name: getattr(view, name) for name in plain},
        **{name: float(getattr(view, name)) for name in ("distance", "explored", "resolution")},
        "x": float(view.origin[0]),
        "y": float(view.origin[1]),
        "rows": rows,
        "columns": columns,
        "cells": np.frombuffer(packed, np.uint8),
    }


def read_view(fields: Fields) -> EpisodeView:
    """Read a view that may come from anywhere.

    Raises:
        MessageError: a field is missing, malformed or beyond its bounds.
    """
    viewpoints = _places(fields, "viewpoints", MAX_VIEWPOINTS)
    kinds = fields.array("kinds", np.uint8, (len(viewpoints),))
    if kinds.size and int(kinds.max()) > USEFUL:
        fields.fail("kinds", f"must be 0 to {USEFUL}, got {int(kinds.max())}")
    edges = fields.array("edges", np.uint16, (None, 2))
    if len(edges) > MAX_EDGES or (edges.size and int(edges.max()) >= len(viewpoints)):
        fields.fail("edges", f"must be at most {MAX_EDGES} pairs of viewpoints")
    return EpisodeView(
        actor=fields.identifier("actor"),
        family=fields.identifier("family"),
        world=fields.text("world"),
        task=fields.identifier("task"),
        driver=fields.word("driver", "policy", "expert", "random"),
        version=fields.integer("version", -1),
        step=fields.integer("step"),
        distance=fields.number("distance", 0.0, 1e9),
        explored=fields.number("explored", 0.0, 1.0),
        ended=fields.flag("ended"),
        success=fields.flag("success"),
        resolution=fields.number("resolution", 1e-3, 1e3),
        origin=(fields.number("x", -_MAX_METRES, _MAX_METRES), fields.number("y", -_MAX_METRES, _MAX_METRES)),
        cells=_cells(fields),
        viewpoints=viewpoints,
        kinds=kinds,
        edges=edges,
        **{name: _places(fields, name, MAX_PLACES) for name in _PLACES},
        **{name: _places(fields, name, 1) for name in _SINGLE},
    )


def _places(fields: Fields, name: str, most: int) -> Places:
    found = fields.array(name, np.float32, (None, 2))
    if len(found) > most or not bool(np.all(np.abs(found) <= _MAX_METRES)):
        fields.fail(name, f"must be at most {most} positions within {_MAX_METRES:g} m, got {len(found)}")
    return found


def _cells(fields: Fields) -> NDArray[np.int8]:
    rows, columns = fields.integer("rows", 1, _MAX_SIDE), fields.integer("columns", 1, _MAX_SIDE)
    packed = fields.array("cells", np.uint8, (None,))
    count = rows * columns
    if count > MAX_CELLS or packed.size > _MAX_PACKED:
        fields.fail("cells", f"must be at most {MAX_CELLS} cells in {_MAX_PACKED} bytes, got {rows} x {columns}")
    unpacking = zlib.decompressobj()
    try:
        # A few bytes can promise gigabytes: no more is unpacked than the shape says.
        found = unpacking.decompress(packed.tobytes(), count + 1)
    except zlib.error as error:
        fields.fail("cells", f"must be packed by zlib: {error}")
    if len(found) != count:
        fields.fail("cells", f"must be {rows} x {columns} bytes unpacked")
    cells = np.frombuffer(found, np.int8).reshape(rows, columns)
    if int(cells.min()) < -1 or int(cells.max()) > 100:
        fields.fail("cells", "must be -1 or 0 to 100")
    return cells
