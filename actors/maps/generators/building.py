"""A large building, 130 m x 100 m by default: long corridors, rooms, lobbies with columns and tables."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from actors.maps.generators.base import Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.office import Office
from actors.maps.generators.shapes import blocks_of, box_walls, door_across, door_up, small_boxes
from actors.maps.layout import BLOCK

_WALL = 3
_DOOR = 12
_Area = tuple[int, int, int, int]


class Building(Office):
    """Corridors, rooms and lobbies: 518 x 406 px with the outer walls (130 m x 100 m), for tests at a large scale."""

    kind: ClassVar[str] = "building"

    width: Side = 544
    """Width of the image, pixels; a multiple of 16; the building is 26 less."""
    height: Side = 432
    """Height of the image, pixels; a multiple of 16; the building is 26 less."""
    lobbies: Annotated[int, Field(ge=0, le=8)] = 3
    """Most lobbies, each where two corridors cross."""
    tables: Share = 0.25
    """Share of the blocks in lobbies that hold a table or a counter."""
    clutter: Share = 0.08
    """Share of the blocks in corridors that hold a cabinet or a bench."""

    def plan(self, rng: np.random.Generator) -> Plan:
        """Lay out corridors and rooms over the whole image, then put lobbies where corridors cross."""
        free = np.zeros((self.height, self.width), dtype=np.bool_)
        area = (1, 1, self.width // BLOCK - 2, self.height // BLOCK - 2)
        left, bottom, width, height = area
        free[bottom * BLOCK : (bottom + height) * BLOCK, left * BLOCK : (left + width) * BLOCK] = True
        spines, corridors = self._lay_out(rng, free, area)
        for row in corridors:
            self._equip(rng, free, (left, row, width, self.corridor), self.clutter)
        for column in spines:
            self._equip(rng, free, (column, bottom, self.corridor, height), self.clutter)
        crossings = [(column, row) for column in spines for row in corridors]
        for number in rng.permutation(len(crossings))[: self.lobbies].tolist():
            self._lobby(rng, free, area, crossings[number])
        box_walls(free, area, 2 * _WALL)
        return finish(free, rng)

    def _lobby(
        self, rng: np.random.Generator, free: NDArray[np.bool_], building: _Area, crossing: tuple[int, int]
    ) -> None:
        """Replace what is around a crossing by one open place, with the corridors leading into it."""
        column, row = crossing
        left = max(column - int(rng.integers(2, 5)), building[0])
        bottom = max(row - int(rng.integers(1, 4)), building[1])
        right = min(column + self.corridor + int(rng.integers(2, 5)), building[0] + building[2])
        top = min(row + self.corridor + int(rng.integers(1, 4)), building[1] + building[3])
        area = (left, bottom, right - left, top - bottom)
        free[bottom * BLOCK : top * BLOCK, left * BLOCK : right * BLOCK] = True
        box_walls(free, area, _WALL)
        for lane in range(self.corridor):
            door_across(free, left, row + lane, _DOOR, _WALL)
            door_across(free, right, row + lane, _DOOR, _WALL)
            door_up(free, column + lane, bottom, _DOOR, _WALL)
            door_up(free, column + lane, top, _DOOR, _WALL)
        for j in range(bottom + 1, top, 2):
            for i in range(left + 1, right, 2):
                free[j * BLOCK - 2 : j * BLOCK + 2, i * BLOCK - 2 : i * BLOCK + 2] = False
        self._equip(rng, free, area, self.tables)

    @staticmethod
    def _equip(rng: np.random.Generator, free: NDArray[np.bool_], area: _Area, share: float) -> None:
        """Put things into a share of the blocks of an area."""
        blocks = blocks_of(area)
        small_boxes(rng, free, blocks[rng.random(len(blocks)) < share])
