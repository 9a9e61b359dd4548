"""Pairs of a frontier and a viewpoint in range of it: in sight of each other, or blocked by a cell that is remembered.

A blocked pair stays blocked as long as that cell is not free, and a pair in sight stays in sight as long as no cell
was lost, so an update tests a line of sight only when its answer can have changed. Where cells are fine, one frontier
of a block stands for all of them (`common.mapping.thinning`).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.mapping.raycast import SUBCELL_BITS, cell_middle
from common.mapping.sight import CLEAR, FREE, Box, blocker, may_touch
from common.mapping.squares import Layout
from common.mapping.thinning import Blocks, block_at, list_block
from common.system.copies import copy_values
from common.system.jit import njit

IN_SIGHT: Final = CLEAR


class Pairs(NamedTuple):
    """Frontiers, one of each block, and the viewpoints in range of them; all int32.

    Attributes:
        cell: flat cell that each slot's pairs are drawn to, shape (capacity,).
        weight: frontier cells for which it stands, itself included.
        filled: pairs of each slot.
        piece: their pieces, shape (capacity, most).
        state: IN_SIGHT or the blocking cell, same shape.
    """

    cell: NDArray[np.int32]
    weight: NDArray[np.int32]
    filled: NDArray[np.int32]
    piece: NDArray[np.int32]
    state: NDArray[np.int32]


def room_for(capacity: int, width: int) -> Pairs:
    """Return pairs for so many slots and viewpoints each; memory that nothing is written to is never really taken."""
    return Pairs(*np.empty((3, capacity), dtype=np.int32), *np.empty((2, capacity, width), dtype=np.int32))


@njit(cache=True, nogil=True)
def copy_pairs(old: Pairs, new: Pairs, used: int) -> None:
    """Copy what is in use: rows are a fraction full, and a copy of whole ones would make a step wait."""
    for slot in range(used):
        count = old.filled[slot]
        new.cell[slot], new.weight[slot], new.filled[slot] = old.cell[slot], old.weight[slot], count
        copy_values(new.piece[slot], old.piece[slot, :count])
        copy_values(new.state[slot], old.state[slot, :count])


@njit(cache=True, nogil=True)
def _regroup(
    mask: NDArray[np.bool_],
    width: int,
    blocks: Blocks,
    removed: NDArray[np.int32],
    added: NDArray[np.int32],
    counts: NDArray[np.int32],
    slots: NDArray[np.int32],
    listed: NDArray[np.bool_],
    pairs: Pairs,
    used: int,
) -> tuple[int, NDArray[np.int32]]:
    """Bring the blocks of some cells up to date: give up slots whose cell stands for its block no more.

    Args:
        mask: frontier cells of the padded grid, flat, bool.
        width: its cells per row.
        blocks: of the grid.
        removed: flat cells that are frontiers no more, int32.
        added: flat cells that became frontiers, int32.
        counts: see `update_sight`.
        slots: likewise.
        listed: likewise.
        pairs: likewise.
        used: slots in use.

    Returns:
        Slots in use now, and the blocks that need a slot, int32.
    """
    found = np.empty(len(removed) + len(added), dtype=np.int32)
    size = 0
    for cells in (removed, added):
        for cell in cells:
            block = block_at(blocks, cell, width)
            if not listed[block]:
                listed[block] = True
                found[size] = block
                size += 1
    members = np.empty(blocks.side * blocks.side, dtype=np.int32)
    kept = 0
    for n in range(size):
        block = found[n]
        listed[block] = False
        slot = slots[block]
        weight = list_block(mask, width, blocks, block, members)
        if slot >= 0:
            gained = weight - pairs.weight[slot]
            if weight and pairs.cell[slot] == members[0]:
                if gained:
                    pairs.weight[slot] = weight
                    for k in range(pairs.filled[slot]):
                        if pairs.state[slot, k] == IN_SIGHT:
                            counts[pairs.piece[slot, k]] += gained
                continue
            for k in range(pairs.filled[slot]):
                if pairs.state[slot, k] == IN_SIGHT:
                    counts[pairs.piece[slot, k]] -= pairs.weight[slot]
            used -= 1
            if slot != used:
                count = pairs.filled[used]
                pairs.filled[slot] = count
                copy_values(pairs.piece[slot], pairs.piece[used, :count])
                copy_values(pairs.state[slot], pairs.state[used, :count])
                pairs.cell[slot] = pairs.cell[used]
                pairs.weight[slot] = pairs.weight[used]
                slots[block_at(blocks, pairs.cell[slot], width)] = slot
            slots[block] = -1
        if weight:
            found[kept] = block
            kept += 1
    return used, found[:kept]


@njit(cache=True, nogil=True)
def update_sight(
    cells: NDArray[np.int8],
    mask: NDArray[np.bool_],
    width: int,
    blocks: Blocks,
    pieces: Any,
    first_of: NDArray[np.int32],
    layout: Layout,
    counts: NDArray[np.int32],
    reach: int,
    slots: NDArray[np.int32],
    listed: NDArray[np.bool_],
    pairs: Pairs,
    used: int,
    added: NDArray[np.int32],
    removed: NDArray[np.int32],
    fresh: NDArray[np.int32],
    ended: NDArray[np.int32],
    changed: Box,
    lost: Box,
) -> int:
    """Bring the counts of observable frontiers up to date.

    Blocks with frontiers live in slots 0 .. used - 1; the pairs of slot s are the first ``pairs.filled[s]`` of its row.

    Args:
        cells: padded grid, flat, int8.
        mask: its frontier cells, flat, bool.
        width: its cells per row.
        blocks: of the grid.
        pieces: all pieces, see `common.mapping.pieces`.
        first_of: first piece of each square.
        layout: of the squares.
        counts: frontiers in range and in sight of each piece's viewpoint, int32; brought up to date.
        reach: observable range, subcells.
        slots: slot of each block or -1, int32.
        listed: room for a mark of each block, bool; all of them False before and after.
        pairs: of the slots.
        used: slots in use.
        added: flat cells of new frontiers, int32.
        removed: flat cells that are frontiers no more, int32.
        fresh: pieces whose viewpoint is new, int32.
        ended: pieces whose viewpoint is no more, int32.
        changed: box of all cells that changed, and of all viewpoints that came or went.
        lost: box of the cells that are free no more; its second number is -1 when there are none.

    Returns:
        Slots in use now.
    """
    any_lost = lost[1] >= 0
    used, without_slot = _regroup(mask, width, blocks, removed, added, counts, slots, listed, pairs, used)

    counts[fresh] = 0
    is_ended = np.zeros(len(pieces), dtype=np.bool_)
    is_ended[ended] = True
    reach_cells = (reach >> SUBCELL_BITS) + 2
    for slot in range(used):
        row, column = pairs.cell[slot] // width, pairs.cell[slot] % width
        if (
            row < changed[0] - reach_cells
            or row > changed[1] + reach_cells
            or column < changed[2] - reach_cells
            or column > changed[3] + reach_cells
        ):
            continue
        x, y = cell_middle(pairs.cell[slot], width)
        weight = pairs.weight[slot]
        count = pairs.filled[slot]
        k = 0
        while k < count:
            piece, state = pairs.piece[slot, k], pairs.state[slot, k]
            if is_ended[piece]:
                count -= 1
                pairs.piece[slot, k] = pairs.piece[slot, count]
                pairs.state[slot, k] = pairs.state[slot, count]
                continue
            if state == IN_SIGHT:
                test = any_lost and may_touch(x, y, pieces[piece].x, pieces[piece].y, lost)
            else:
                test = cells[state] == FREE
            if test:
                found = blocker(cells, width, x, y, pieces[piece].x, pieces[piece].y)
                counts[piece] += weight * ((found == CLEAR) - (state == IN_SIGHT))
                pairs.state[slot, k] = found
            k += 1
        for f in range(len(fresh)):
            to_x, to_y = pieces[fresh[f]].x, pieces[fresh[f]].y
            if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                found = blocker(cells, width, x, y, to_x, to_y)
                counts[fresh[f]] += weight * (found == CLEAR)
                pairs.piece[slot, count], pairs.state[slot, count] = fresh[f], found
                count += 1
        pairs.filled[slot] = count

    columns = len(layout.x)
    members = np.empty(blocks.side * blocks.side, dtype=np.int32)
    for block in without_slot:
        slot = used
        used += 1
        slots[block] = slot
        weight = list_block(mask, width, blocks, block, members)
        pairs.cell[slot], pairs.weight[slot] = members[0], weight
        x, y = cell_middle(members[0], width)
        count = 0
        cell_low, cell_high = (
            max((y - reach) >> SUBCELL_BITS, 0),
            min((y + reach) >> SUBCELL_BITS, len(cells) // width - 1),
        )
        left, right = max((x - reach) >> SUBCELL_BITS, 0), min((x + reach) >> SUBCELL_BITS, width - 1)
        for j in range(layout.row_of[cell_low], layout.row_of[cell_high] + 1):
            for i in range(layout.column_of[left], layout.column_of[right] + 1):
                piece = first_of[j * columns + i]
                while piece >= 0:
                    if pieces[piece].exists:
                        to_x, to_y = pieces[piece].x, pieces[piece].y
                        if (to_x - x) ** 2 + (to_y - y) ** 2 <= reach * reach:
                            found = blocker(cells, width, x, y, to_x, to_y)
                            counts[piece] += weight * (found == CLEAR)
                            pairs.piece[slot, count], pairs.state[slot, count] = piece, found
                            count += 1
                    piece = pieces[piece].next
        pairs.filled[slot] = count
    return used
