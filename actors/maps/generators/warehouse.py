"""Long parallel racks with cross aisles, a dock, pallets on the floor."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from actors.maps.generators.base import Generator, Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.shapes import blocks_of, box_walls, small_boxes
from actors.maps.layout import BLOCK


class Warehouse(Generator):
    """Rows of racks that look the same from every aisle; the only landmarks are gaps, the dock and pallets."""

    kind: ClassVar[str] = "warehouse"

    width: Side = 448
    """Width of the image, pixels; a multiple of 16."""
    height: Side = 336
    """Height of the image, pixels; a multiple of 16."""
    aisle: Annotated[int, Field(ge=1, le=4)] = 1
    """Blocks from one row of racks to the next; the racks take about half of a block (2 m) of it."""
    rack_length: Annotated[int, Field(ge=2, le=30)] = 6
    """Mean length of a rack between two cross aisles, blocks."""
    filled: Share = 0.9
    """Share of the racks that are there."""
    pallets: Share = 0.15
    """Share of the dock's blocks with a pallet on the floor."""

    def plan(self, rng: np.random.Generator) -> Plan:
        """Put up walls, rows of racks with cross aisles, and pallets on the dock."""
        free = np.zeros((self.height, self.width), dtype=np.bool_)
        columns, rows = self.width // BLOCK - 2, self.height // BLOCK - 2
        width = int(rng.integers(max(4, columns * 3 // 4), columns + 1))
        height = int(rng.integers(max(4, rows * 3 // 4), rows + 1))
        left = 1 + int(rng.integers(columns - width + 1))
        bottom = 1 + int(rng.integers(rows - height + 1))
        free[bottom * BLOCK : (bottom + height) * BLOCK, left * BLOCK : (left + width) * BLOCK] = True
        box_walls(free, (left, bottom, width, height), 6)
        hall = free[bottom * BLOCK : (bottom + height) * BLOCK, left * BLOCK : (left + width) * BLOCK]
        # Views of one array: racks along y are racks along x in the transposed hall, a dock on the right a flipped one.
        if rng.integers(2):
            hall = hall.T
        if rng.integers(2):
            hall = hall[:, ::-1]
        self._equip(rng, hall)
        return finish(free, rng)

    def _equip(self, rng: np.random.Generator, hall: NDArray[np.bool_]) -> None:
        rows, columns = hall.shape[0] // BLOCK, hall.shape[1] // BLOCK
        dock = int(rng.integers(2, max(3, columns // 5) + 1))
        depth = int(rng.integers(7, 10))
        cross = self._cross_aisles(rng, dock, columns)
        for row in range(self.aisle, rows, self.aisle):
            for first, last in cross:
                if rng.random() < self.filled:
                    y = row * BLOCK - depth // 2
                    hall[y : y + depth, first * BLOCK : last * BLOCK] = False
        floor = blocks_of((0, 0, dock, rows))
        small_boxes(rng, hall, floor[rng.random(len(floor)) < self.pallets])

    def _cross_aisles(self, rng: np.random.Generator, dock: int, columns: int) -> list[tuple[int, int]]:
        """Return first and last block border of each rack of a row; the same in every row, as in real stores."""
        racks = []
        column = dock
        while column < columns - 1:
            length = int(rng.integers(max(2, self.rack_length * 2 // 3), self.rack_length * 4 // 3 + 1))
            last = min(column + length, columns - 1)
            racks.append((column, last))
            column = last + 1
        return racks
