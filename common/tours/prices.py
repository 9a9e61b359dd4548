"""What each next waypoint would cost: the covering tour that remains from there, made from the robot's own tour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from common.tours.local_search import improve_tour, tour_length
from common.tours.sighting import count_unseen, popcount, recount, recount_kept, seen_by_one


@njit(cache=True, nogil=True)
def price_choices(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    allowed: NDArray[np.bool_],
    distances: NDArray[np.float32],
    stops: NDArray[np.int64],
    choices: NDArray[np.int64],
    tolerance: int,
    orders: NDArray[np.int64],
    sizes: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Length of the covering tour that remains from each choice, when the robot goes there first.

    Stops whose own cells the choice itself sees are left out; the others keep their order as a beginning.

    Args:
        pointer: sparse visibility rows, see `Visibility`.
        tile: likewise.
        mask: likewise.
        missing: tile words of the missing cells.
        allowed: viewpoints that can show something new, shape (n,).
        distances: metres between all viewpoints, shape (n, n).
        stops: the covering tour from the robot, in order.
        choices: viewpoint number of each choice, -1 for one that the true map does not have.
        tolerance: cells that may stay unseen.
        orders: shape (choices, stops); the order of stops from each choice is written here.
        sizes: shape (choices,); the number of stops from each choice is written here.

    Returns:
        Metres, inf for a choice that is -1, float64, shape (choices,).
    """
    n = len(stops)
    once = np.zeros(len(missing), dtype=np.uint64)
    twice = np.zeros(len(missing), dtype=np.uint64)
    need = np.zeros(len(missing), dtype=np.uint64)
    recount(pointer, tile, mask, stops, n, once, twice)
    slack = max(tolerance - count_unseen(missing, once), 0)
    # Tiles that a stop alone sees, and how much of them: the same for all choices.
    begin = np.zeros(n + 1, dtype=np.int64)
    entries = 0
    for s in range(n):
        entries += pointer[stops[s] + 1] - pointer[stops[s]]
    need_tile = np.empty(entries, dtype=np.int32)
    need_mask = np.empty(entries, dtype=np.uint64)
    alone = np.zeros(n, dtype=np.int64)
    size = 0
    for s in range(n):
        alone[s] = seen_by_one(pointer, tile, mask, missing, once, twice, stops[s], need)
        for k in range(pointer[stops[s]], pointer[stops[s] + 1]):
            word = need[tile[k]]
            if word:
                need_tile[size] = tile[k]
                need_mask[size] = word
                size += 1
                need[tile[k]] = np.uint64(0)
        begin[s + 1] = size
    # The local search reads each distance many times: a table of these places alone stays in the processor's cache.
    table = _table(distances, np.concatenate((stops, choices)))
    seen = np.zeros(len(missing), dtype=np.uint64)
    dropped = np.zeros(n, dtype=np.bool_)
    lengths = np.full(len(choices), np.inf)
    for c in range(len(choices)):
        v = choices[c]
        sizes[c] = 0
        if v < 0:
            continue
        if allowed[v]:
            for k in range(pointer[v], pointer[v + 1]):
                seen[tile[k]] = mask[k]
        spare = slack
        drops = 0
        for s in range(n):
            lost = 0
            for k in range(begin[s], begin[s + 1]):
                lost += popcount(need_mask[k] & ~seen[need_tile[k]])
            dropped[s] = stops[s] == v or (lost <= spare and lost < alone[s]) or alone[s] == 0
            if dropped[s]:
                spare -= lost
                drops += 1
        # Two stops may go only if what they saw together is seen from elsewhere; take stops back until it is.
        while drops:
            recount_kept(pointer, tile, mask, stops, dropped, seen, once)
            if count_unseen(missing, once) <= tolerance:
                break
            back = -1
            for s in range(n):
                if dropped[s] and stops[s] != v:
                    back = s
                    break
            if back < 0:
                break
            dropped[back] = False
            drops -= 1
        if allowed[v]:
            for k in range(pointer[v], pointer[v + 1]):
                seen[tile[k]] = np.uint64(0)
        tour = np.flatnonzero(~dropped)
        improve_tour(table, n + c, tour)
        sizes[c] = len(tour)
        for k in range(len(tour)):
            orders[c, k] = stops[tour[k]]
        lengths[c] = tour_length(table, n + c, tour)
    return lengths


@njit(cache=True, nogil=True)
def _table(distances: NDArray[np.float32], places: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return the distances between some places, infinite for places that are -1."""
    table = np.full((len(places), len(places)), np.inf, dtype=np.float32)
    for a in range(len(places)):
        for b in range(len(places)):
            if places[a] >= 0 and places[b] >= 0:
                table[a, b] = distances[places[a], places[b]]
    return table
