"""Frontier cells by block: where cells are fine, one frontier cell of a block stands for all of them.

Lines of sight to cells a decimetre apart tell the same over and over, and their number, as their length, grows with
the inverse of the cells' side. So the frontier cells of a block of about `COARSE_CELL` share one line: to the first
of them. It counts for as many cells as the block holds, so that utilities mean the same at any resolution.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.belief import Belief
from common.system.jit import njit

# Cells of this side, metres, or more, are each looked at.
COARSE_CELL: Final = 0.25


class Blocks(NamedTuple):
    """Square blocks of cells that lie still in the world when the grid grows.

    Attributes:
        side: cells.
        row_shift: added to a row of the padded grid before it is divided by the side.
        column_shift: likewise to a column.
        rows: of blocks.
        columns: of blocks.
    """

    side: int
    row_shift: int
    column_shift: int
    rows: int
    columns: int


def cells_a_block(resolution: float) -> int:
    """Return the side of the blocks for cells of so many metres: about `COARSE_CELL`, a single cell from there on."""
    return max(int(COARSE_CELL / resolution + 0.5 + 1e-9), 1)


def blocks_of(belief: Belief, side: int) -> Blocks:
    """Return the blocks of a belief's padded grid as it is allocated now."""
    row, column = belief.first_cell
    height, width = belief.padded.shape
    row_shift, column_shift = (row - 1) % side, (column - 1) % side
    return Blocks(
        side, row_shift, column_shift, (height - 1 + row_shift) // side + 1, (width - 1 + column_shift) // side + 1
    )


@njit(cache=True, nogil=True, inline="always")
def block_at(blocks: Blocks, cell: int, width: int) -> int:
    """Return the block of a cell of the padded grid, given by its flat number."""
    row, column = cell // width + blocks.row_shift, cell % width + blocks.column_shift
    return (row // blocks.side) * blocks.columns + column // blocks.side


@njit(cache=True, nogil=True)
def list_block(mask: NDArray[np.bool_], width: int, blocks: Blocks, block: int, cells: NDArray[np.int32]) -> int:
    """Write the frontier cells of a block, row-major.

    Args:
        mask: frontier cells of the padded grid, flat, bool.
        width: its cells per row.
        blocks: of the grid.
        block: which one.
        cells: receives flat cells; at least as long as a block has cells.

    Returns:
        How many there are.
    """
    top = (block // blocks.columns) * blocks.side - blocks.row_shift
    left = (block % blocks.columns) * blocks.side - blocks.column_shift
    count = 0
    for row in range(max(top, 0), min(top + blocks.side, len(mask) // width)):
        for column in range(max(left, 0), min(left + blocks.side, width)):
            if mask[row * width + column]:
                cells[count] = row * width + column
                count += 1
    return count
