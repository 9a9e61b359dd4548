"""One update of the viewpoint graph as two compiled sweeps: the viewpoints of changed squares, then their edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.candidates import forget_pairs, list_pairs, most_pairs, update_pairs
from common.mapping.lookouts import Remains, find_lookouts
from common.mapping.pieces import NOWHERE, Cells
from common.mapping.settling import choose, settle
from common.mapping.sight import Box
from common.mapping.squares import Layout
from common.mapping.standing import cell_for, locate
from common.mapping.touches import find_touches, forget_ways, measure_ways
from common.system.jit import njit

Pairs = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
"""Straight edges as `candidates` keeps them."""
Touches = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]
"""Bent edges as `touches` keeps them."""


@njit(cache=True, nogil=True)
def renew_viewpoints(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    renew: bool,
    dirty: NDArray[np.bool_],
    counts: NDArray[np.int32],
    free: NDArray[np.int32],
    free_count: int,
    margin: int,
    robot: tuple[int, int],
    clear_reach: int,
    visit_reach: int,
    everywhere: bool,
    stay: bool,
    remains: Remains,
    around: NDArray[np.int32],
    been_reach: int,
    pairs: Pairs,
    touches: Touches,
) -> tuple[int, NDArray[np.int32], int, NDArray[np.int32], NDArray[np.int32], int]:
    """Settle the dirty squares, find the robot, choose the viewpoints, and take those that are no more off the lists.

    Returns:
        Height of the stack of free numbers, the pieces that are no more, the robot's piece, the pieces of new and of
        ended viewpoints, and how long a list of pairs can become.
    """
    used = len(pieces)
    touch_count, touched, length = touches
    gone = np.empty(used, dtype=np.int32)
    gone_count = 0
    if renew:
        free_count, gone_count = settle(cells, layout, pieces, first_of, dirty, counts, free, free_count, margin, gone)
        find_touches(cells, pieces, first_of, layout, dirty, touch_count, touched, length)
        dirty[:] = False
    here = locate(cells, layout, pieces, first_of, robot, clear_reach, visit_reach, margin)
    fresh = np.empty(used, dtype=np.int32)
    ended = np.empty(used + gone_count, dtype=np.int32)
    lookouts = np.full((used, 2), NOWHERE, dtype=np.int64)
    # A robot outside of all pieces looks for no lookouts, and so none stays either.
    stay = stay and here >= 0
    if here >= 0 and (everywhere or (stay and pieces[here].visited)):
        cells.been[cell_for(cells, robot[0], robot[1], clear_reach)] = True
        pieces[here].visited = True
    if here >= 0 and len(remains.frontiers):
        find_lookouts(cells, layout, pieces, first_of, remains, around, been_reach, everywhere, lookouts)
    fresh_count, ended_count = choose(
        cells, layout, pieces, used, touch_count, touched, here, everywhere, lookouts, stay, margin, fresh, ended
    )
    for k in range(gone_count):
        if pieces[gone[k]].exists:
            pieces[gone[k]].exists = False
            ended[ended_count] = gone[k]
            ended_count += 1
    forget_pairs(pieces, first_of, layout, ended[:ended_count], pairs[0], pairs[1], pairs[2])
    forget_ways(pieces, first_of, layout, fresh[:fresh_count], touch_count, touched, length)
    most = most_pairs(pieces, first_of, layout, fresh[:fresh_count])
    return free_count, gone[:gone_count].copy(), here, fresh[:fresh_count].copy(), ended[:ended_count].copy(), most


@njit(cache=True, nogil=True)
def renew_edges(
    cells: Cells,
    layout: Layout,
    pieces: Any,
    first_of: NDArray[np.int32],
    changed: Box,
    lost: Box,
    edge_reach: int,
    pairs: Pairs,
    touches: Touches,
    fresh: NDArray[np.int32],
    ended: NDArray[np.int32],
    box: Box,
) -> Box:
    """Bring the edges up to date for a box of cells of another clearance, and for viewpoints that are new.

    Returns:
        A box of cells around ``box``, empty where its second number is -1, and around viewpoints that came or went.
    """
    count, other, state = pairs
    if changed[1] >= 0:
        update_pairs(cells, pieces, first_of, layout, changed, lost, count, other, state)
    list_pairs(cells, pieces, first_of, layout, fresh, edge_reach, count, other, state)
    touch_count, touched, length = touches
    measure_ways(cells, pieces, len(pieces), layout, count, other, state, touch_count, touched, length)
    columns = len(layout.x)
    for moved in (fresh, ended):
        for piece in moved:
            # A viewpoint that moved was, and is, somewhere in its square.
            j, i = pieces[piece].square // columns, pieces[piece].square % columns
            top, left = layout.row_begin[j], layout.column_begin[i]
            bottom, right = layout.row_begin[j + 1] - 1, layout.column_begin[i + 1] - 1
            if box[1] < 0:
                box = (top, bottom, left, right)
            else:
                box = (min(box[0], top), max(box[1], bottom), min(box[2], left), max(box[3], right))
    return box
