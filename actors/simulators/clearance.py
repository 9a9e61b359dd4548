"""Room for a round robot on a grid map."""

from __future__ import annotations

import numpy as np

from actors.maps.grid_map import GridMap
from common.errors import SimulatorError

_SEARCH = 3.0  # metres around a position


def clearance(world: GridMap, position: tuple[float, float], reach: float) -> float:
    """Distance from a position to the nearest occupied cell, metres; ``reach`` where there is none that near."""
    resolution = world.resolution
    row, column = world.cell(position)
    span = int(np.ceil(reach / resolution)) + 1
    rows = np.arange(row - span, row + span + 1)
    columns = np.arange(column - span, column + span + 1)
    inside = ((rows >= 0) & (rows < world.free.shape[0]))[:, None] & ((columns >= 0) & (columns < world.free.shape[1]))[
        None, :
    ]
    occupied = np.ones(inside.shape, dtype=np.bool_)
    occupied[inside] = ~world.free[np.ix_(rows[inside.any(1)], columns[inside.any(0)])].ravel()
    left = world.origin[0] + columns * resolution - position[0]
    low = world.origin[1] + rows * resolution - position[1]
    dx = np.maximum(np.maximum(left, -left - resolution), 0.0)
    dy = np.maximum(np.maximum(low, -low - resolution), 0.0)
    distance = np.hypot(dx[None, :], dy[:, None])[occupied]
    return float(min(distance.min(initial=np.inf), reach))


def nearest_clear(world: GridMap, position: tuple[float, float], radius: float) -> tuple[float, float]:
    """Return the position, or the nearest cell centre or corner within 3 m that has ``radius`` metres of room.

    Raises:
        SimulatorError: there is none.
    """
    if clearance(world, position, radius) >= radius:
        return position
    half = 0.5 * world.resolution
    row, column = world.cell(position)
    span = round(2.0 * _SEARCH / world.resolution)
    steps = np.arange(-span, span + 1)
    x = world.origin[0] + (column + 0.5) * world.resolution + steps * half
    y = world.origin[1] + (row + 0.5) * world.resolution + steps * half
    distance = np.hypot(x[None, :] - position[0], y[:, None] - position[1])
    for index in np.argsort(distance, axis=None, kind="stable"):
        i, j = np.unravel_index(index, distance.shape)
        candidate = (float(x[j]), float(y[i]))
        if distance[i, j] > _SEARCH:
            break
        if world.is_free(candidate) and clearance(world, candidate, radius) >= radius:
            return candidate
    raise SimulatorError(
        f"map {world.name!r}: no room for a robot of {radius:.2f} m radius within {_SEARCH} m of {position}: "
        "use a map with wider passages, or kinematic fidelity"
    )
