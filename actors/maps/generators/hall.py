"""A large indoor hall, 130 m x 100 m by default: long sights, columns, islands, wings behind partitions, side rooms."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from actors.maps.generators.base import Generator, Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.shapes import blocks_of, box_walls, door_across, door_up, lattice_line, small_boxes, wall
from actors.maps.layout import BLOCK

_WALL = 4
_DOOR = 12
_SIDE_WALL = 12
_END_WALL = 16


class Hall(Generator):
    """One hall of 520 x 400 px inside its walls, for tests at a large scale."""

    kind: ClassVar[str] = "hall"

    width: Side = 544
    """Width of the image, pixels; a multiple of 16; the walls take 24 of them."""
    height: Side = 432
    """Height of the image, pixels; a multiple of 16; the walls take 32 of them."""
    columns: Annotated[int, Field(ge=2, le=10)] = 4
    """Distance between columns, blocks of 16 px (4 m)."""
    partitions: Annotated[int, Field(ge=0, le=12)] = 6
    """Walls across the hall, each with one to three openings."""
    islands: Share = 0.25
    """Share of the places between the columns with an island: a stand, a counter, a group of tables."""
    side_rooms: Share = 0.6
    """Share of the hall's edge with rooms along it."""

    def plan(self, rng: np.random.Generator) -> Plan:
        """Build the shell, then columns, islands, partitions and side rooms."""
        free = np.zeros((self.height, self.width), dtype=np.bool_)
        free[_END_WALL : self.height - _END_WALL, _SIDE_WALL : self.width - _SIDE_WALL] = True
        columns, rows = self.width // BLOCK, self.height // BLOCK
        for row in range(self.columns, rows - 1, self.columns):
            for column in range(self.columns, columns - 1, self.columns):
                free[row * BLOCK - 2 : row * BLOCK + 2, column * BLOCK - 2 : column * BLOCK + 2] = False
                if rng.random() < self.islands:
                    self._island(rng, free, column, row)
        for _ in range(self.partitions):
            self._partition(rng, free, bool(rng.integers(2)))
        for bottom, into in ((1, True), (rows - 4, False)):
            column = 1
            while column < columns - 3:
                wide = min(int(rng.integers(2, 6)), columns - 1 - column)
                if rng.random() < self.side_rooms:
                    self._side_room(rng, free, (column, bottom, wide, 3), into)
                column += wide
        return finish(free, rng)

    def _island(self, rng: np.random.Generator, free: NDArray[np.bool_], column: int, row: int) -> None:
        """Put one box, or a group of small ones, into the field above and right of a column."""
        wide, high = (int(side) for side in rng.integers(1, self.columns, size=2))
        if rng.integers(2):
            x, y = lattice_line(column) + 4, lattice_line(row) + 4
            free[y : y + high * BLOCK - 8, x : x + wide * BLOCK - 8] = False
        else:
            small_boxes(rng, free, blocks_of((column, row, wide, high)))

    def _partition(self, rng: np.random.Generator, free: NDArray[np.bool_], across: bool) -> None:
        """Put a wall over a part of the hall, with openings on lattice lines."""
        rows, columns = self.height // BLOCK, self.width // BLOCK
        length, breadth = (columns, rows) if across else (rows, columns)
        if breadth < 12:
            return
        at = int(rng.integers(4, breadth - 4))
        first = int(rng.integers(1, max(2, length // 2)))
        last = int(rng.integers(min(first + length // 3, length - 1), length))
        if across:
            wall(free, first * BLOCK, at * BLOCK, last * BLOCK, at * BLOCK, _WALL)
        else:
            wall(free, at * BLOCK, first * BLOCK, at * BLOCK, last * BLOCK, _WALL)
        for _ in range(int(rng.integers(1, 4))):
            block = int(rng.integers(first, max(first + 1, last)))
            (door_up if across else door_across)(free, *((block, at) if across else (at, block)), _DOOR, _WALL)

    def _side_room(
        self, rng: np.random.Generator, free: NDArray[np.bool_], area: tuple[int, int, int, int], into: bool
    ) -> None:
        """Put a room of three blocks' depth at the lower or upper edge, with a door into the hall."""
        box_walls(free, area, _WALL)
        left, bottom, wide, high = area
        column = left + int(rng.integers(wide))
        door_up(free, column, bottom + high if into else bottom, _DOOR, _WALL)
