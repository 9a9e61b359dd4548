"""Winding passages of changing width, as in caves and mines."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from actors.maps.generators.base import Generator, Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.shapes import carve_path, fill_disc, smooth_noise
from actors.maps.layout import BLOCK
from common.system.jit import njit

_PITCH = 6 * BLOCK
_MARGIN = 2 * BLOCK
_ROUGHNESS = 12


class Tunnel(Generator):
    """A net of winding tunnels with chambers, loops and dead ends."""

    kind: ClassVar[str] = "tunnel"

    width: Side = 528
    """Width of the image, pixels; a multiple of 16."""
    height: Side = 400
    """Height of the image, pixels; a multiple of 16."""
    loops: Share = 0.25
    """Chance of each tunnel that is not needed for connection, which closes a loop."""
    chambers: Share = 0.3
    """Share of junctions that widen into a chamber."""
    min_width: Annotated[int, Field(ge=12, le=64)] = 16
    """Narrowest passage before roughening, pixels."""
    max_width: Annotated[int, Field(ge=12, le=64)] = 32
    """Widest passage, pixels."""

    @model_validator(mode="after")
    def _widths_in_order(self) -> Tunnel:
        if self.max_width < self.min_width:
            raise ValueError(f"max_width ({self.max_width}) must not be below min_width ({self.min_width})")
        return self

    def plan(self, rng: np.random.Generator) -> Plan:
        """Join jittered junctions by a random tree and some loops, carve winding bands, roughen the walls."""
        free = np.zeros((self.height, self.width), dtype=np.bool_)
        junctions = self._junctions(rng)
        for a, b in self._tunnels(rng, junctions.shape[0], junctions.shape[1]):
            points = _wind(rng, junctions[a], junctions[b])
            points[:, 0] = np.clip(points[:, 0], 2 * _MARGIN, 2 * (self.width - _MARGIN))
            points[:, 1] = np.clip(points[:, 1], 2 * _MARGIN, 2 * (self.height - _MARGIN))
            radii = rng.integers(self.min_width, self.max_width + 1, size=len(points))
            carve_path(free, points, radii, 4)
        for x, y in junctions.reshape(-1, 2):
            chance, radius = rng.random(), int(rng.integers(2 * BLOCK, 4 * BLOCK))
            if chance < self.chambers and free[int(y) // 2, int(x) // 2]:
                fill_disc(free, int(x), int(y), radius * radius, True)
        return finish(_roughen(rng, free), rng)

    def _junctions(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Return (x, y) in half pixels, int64, shape (rows, columns, 2): a grid with jitter."""
        across, up = self.width - 2 * _MARGIN, self.height - 2 * _MARGIN
        rows, columns = max(2, up // _PITCH + 1), max(2, across // _PITCH + 1)
        grid = np.empty((rows, columns, 2), dtype=np.int64)
        grid[..., 0] = 2 * _MARGIN + (2 * across * (2 * np.arange(columns) + 1) // (2 * columns))[None, :]
        grid[..., 1] = 2 * _MARGIN + (2 * up * (2 * np.arange(rows) + 1) // (2 * rows))[:, None]
        return grid + rng.integers(-_PITCH // 2, _PITCH // 2 + 1, size=grid.shape)

    def _tunnels(
        self, rng: np.random.Generator, rows: int, columns: int
    ) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """Return pairs of neighbouring junctions: a random spanning tree of most of them, and extra ones."""
        pairs = [((j, i), (j, i + 1)) for j in range(rows) for i in range(columns - 1)]
        pairs += [((j, i), (j + 1, i)) for j in range(rows - 1) for i in range(columns)]
        group = {(j, i): j * columns + i for j in range(rows) for i in range(columns)}
        chosen = []
        for number in rng.permutation(len(pairs)):
            a, b = pairs[int(number)]
            extra = rng.random() < self.loops
            if group[a] != group[b]:
                old, new = group[a], group[b]
                group = {key: new if value == old else value for key, value in group.items()}
                chosen.append((a, b))
            elif extra:
                chosen.append((a, b))
        return chosen


def _wind(rng: np.random.Generator, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a winding polyline between two points by displacing midpoints, int64, shape (9, 2)."""
    points = np.empty((9, 2), dtype=np.int64)
    points[0], points[8] = a, b
    moves = rng.integers(-1000, 1001, size=(9, 2))
    for gap in (4, 2, 1):
        first, second = points[: 9 - gap : 2 * gap], points[2 * gap :: 2 * gap]
        reach = np.abs(second - first).max(axis=1, keepdims=True) // 4 + 1
        points[gap : 9 - gap : 2 * gap] = (first + second) // 2 + moves[gap : 9 - gap : 2 * gap] * reach // 1000
    return points


def _roughen(rng: np.random.Generator, free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells with walls shifted by up to 4 px along two noises, as if broken from rock."""
    shape = (free.shape[0], free.shape[1])
    return _shift(free, smooth_noise(rng, shape, _ROUGHNESS), smooth_noise(rng, shape, _ROUGHNESS))


@njit(cache=True, nogil=True)
def _shift(free: NDArray[np.bool_], across: NDArray[np.int64], up: NDArray[np.int64]) -> NDArray[np.bool_]:
    rows, columns = free.shape
    shifted = np.zeros_like(free)
    for row in range(rows):
        for column in range(columns):
            y = row + (up[row, column] - 500) * 8 // 1000
            x = column + (across[row, column] - 500) * 8 // 1000
            shifted[row, column] = free[min(max(y, 0), rows - 1), min(max(x, 0), columns - 1)]
    return shifted
