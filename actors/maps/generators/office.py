"""Offices along corridors: thin walls, doors of two metres, many rooms that look alike."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from actors.maps.generators.base import Generator, Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.shapes import blocks_of, box_walls, door_across, door_up, small_boxes
from actors.maps.layout import BLOCK

_WALL = 3
_DOOR = 8
_Area = tuple[int, int, int, int]


class Office(Generator):
    """A building with corridors along x, one or two across all of it, and rooms with doors beside them."""

    kind: ClassVar[str] = "office"

    width: Side = 448
    """Width of the image, pixels; a multiple of 16."""
    height: Side = 336
    """Height of the image, pixels; a multiple of 16."""
    room_side: Annotated[int, Field(ge=2, le=8)] = 3
    """Mean side of the rooms, blocks of 16 px (4 m)."""
    corridor: Annotated[int, Field(ge=1, le=3)] = 1
    """Width of the corridors, blocks."""
    extra_doors: Share = 0.15
    """Chance of a door between two neighbouring rooms, beside the doors to the corridor."""
    furniture: Share = 0.3
    """Share of the blocks in rooms that hold a desk or a cabinet."""

    def plan(self, rng: np.random.Generator) -> Plan:
        """Lay out storeys of rooms between corridors, then open doors and furnish."""
        free = np.zeros((self.height, self.width), dtype=np.bool_)
        area = self._building(rng)
        left, bottom, width, height = area
        free[bottom * BLOCK : (bottom + height) * BLOCK, left * BLOCK : (left + width) * BLOCK] = True
        box_walls(free, area, 2 * _WALL)
        self._lay_out(rng, free, area)
        return finish(free, rng)

    def _lay_out(self, rng: np.random.Generator, free: NDArray[np.bool_], area: _Area) -> tuple[list[int], list[int]]:
        """Fill an area with rooms; return the first columns of corridors along y, the first rows of those along x."""
        left, bottom, width, height = area
        spines = self._spines(rng, left, width)
        wings = list(zip([left, *(s + self.corridor for s in spines)], [*spines, left + width], strict=True))
        row = bottom
        corridors: list[int] = []
        below = False  # whether a corridor runs below the rooms that come next
        while row < bottom + height:
            deep = min(self._side(rng), bottom + height - row)
            rest = bottom + height - row - deep
            if rest < self.corridor + 2:  # no place for a corridor and more rooms: the last row is deeper
                deep, rest = deep + rest, 0
            above = rest > 0 and not below
            for first, last in wings:
                self._row_of_rooms(rng, free, (first, row, last - first, deep), below, above, last < left + width)
            if above:
                corridors.append(row + deep)
            row += deep + (self.corridor if above else 0)
            below = above
        return spines, corridors

    def _spines(self, rng: np.random.Generator, left: int, width: int) -> list[int]:
        """Return the first column of each corridor that crosses the whole building along y, ascending."""
        wings = 3 if width >= 24 and rng.integers(2) else 2
        share = width // wings
        return [left + wing * share + int(rng.integers(-(share // 4), share // 4 + 1)) for wing in range(1, wings)]

    def _building(self, rng: np.random.Generator) -> _Area:
        """Return the building, three quarters of the image or more on each side."""
        columns, rows = self.width // BLOCK - 2, self.height // BLOCK - 2
        width = int(rng.integers(max(4, columns * 3 // 4), columns + 1))
        height = int(rng.integers(max(4, rows * 3 // 4), rows + 1))
        return (
            1 + int(rng.integers(columns - width + 1)),
            1 + int(rng.integers(rows - height + 1)),
            width,
            height,
        )

    def _side(self, rng: np.random.Generator) -> int:
        return int(rng.integers(max(2, self.room_side - 1), self.room_side + 2))

    def _row_of_rooms(
        self, rng: np.random.Generator, free: NDArray[np.bool_], area: _Area, below: bool, above: bool, spine: bool
    ) -> None:
        """Cut an area into rooms side by side; ``spine`` says that a corridor runs along its right side."""
        left, bottom, width, height = area
        column, end = left, left + width
        while column < end:
            wide = min(self._side(rng), end - column)
            if end - column - wide < 2:
                wide = end - column
            room = (column, bottom, wide, height)
            box_walls(free, room, _WALL)
            if below:
                door_up(free, column + int(rng.integers(wide)), bottom, _DOOR, _WALL)
            if above:
                door_up(free, column + int(rng.integers(wide)), bottom + height, _DOOR, _WALL)
            # Rooms without a corridor of their own open into each other and, at the end, into a spine.
            inner = not (below or above)
            if column > left and (inner or rng.random() < self.extra_doors):
                door_across(free, column, bottom + int(rng.integers(height)), _DOOR, _WALL)
            column += wide
            if spine and column == end and inner:
                door_across(free, column, bottom + int(rng.integers(height)), _DOOR, _WALL)
            if not spine and column - wide == left and inner:
                door_across(free, left, bottom + int(rng.integers(height)), _DOOR, _WALL)
            blocks = blocks_of(room)
            small_boxes(rng, free, blocks[rng.random(len(blocks)) < self.furniture])
