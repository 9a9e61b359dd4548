"""Small worlds drawn as text, for tests: '.' is free, '#' a wall, 'S' the start, 'T' the target; 1 m per character."""

from __future__ import annotations

import numpy as np

from actors.maps.grid_map import GridMap


def draw(
    *rows: str, resolution: float = 0.5, lattice: tuple[float, float] = (0.5, 0.5), name: str = "drawn"
) -> GridMap:
    """Return the world of a drawing; one character is 1 m x 1 m, the last row the bottom one at y = 0."""
    drawing = np.array([list(row) for row in reversed(rows)])
    factor = round(1.0 / resolution)
    free = np.kron(drawing != "#", np.ones((factor, factor), dtype=np.bool_))

    def place(letter: str) -> tuple[float, float] | None:
        found = np.argwhere(drawing == letter)
        return None if len(found) == 0 else (float(found[0][1]) + 0.5, float(found[0][0]) + 0.5)

    start = place("S")
    assert start is not None
    return GridMap(
        name=name,
        free=free,
        resolution=resolution,
        origin=(0.0, 0.0),
        start=start,
        target=place("T"),
        target_region=None,
        lattice_origin=lattice,
    )
