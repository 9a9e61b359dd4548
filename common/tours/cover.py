"""Which viewpoints to visit so that little enough stays unseen, and in which order: a covering tour.

Works on the sparse visibility rows of `common.tours.sighting`; "missing" always are the tile words of the cells
that are still to be seen, and a tolerance says how many of them may stay so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.copies import copy_values
from common.system.jit import njit
from common.tours.local_search import GAIN, improve_tour, insert_all
from common.tours.sighting import count_bits, count_seen, count_unseen, popcount, recount, remove_seen, seen_by_one


@njit(cache=True, nogil=True)
def count_gains(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    allowed: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Missing cells that each allowed viewpoint sees, int64, shape (n,); 0 for the others."""
    n = len(allowed)
    gains = np.zeros(n, dtype=np.int64)
    for v in range(n):
        if allowed[v]:
            gains[v] = count_seen(pointer, tile, mask, missing, v)
    return gains


@njit(cache=True, nogil=True)
def greedy_cover(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    gains: NDArray[np.int64],
    weights: NDArray[np.float64],
    left: int,
    tolerance: int,
) -> NDArray[np.int64]:
    """Greedy set cover: take the viewpoint of the largest weighted gain until at most ``tolerance`` cells are left.

    Gains only shrink as cells are covered, so a stale gain is an upper bound and only the leader is counted again.

    Args:
        pointer: sparse visibility rows, see `Visibility`.
        tile: likewise.
        mask: likewise.
        missing: overwritten: ends as what is still uncovered.
        gains: missing cells that each viewpoint sees now; overwritten.
        weights: factor on each gain, 1 for the plain rule.
        left: number of missing cells.
        tolerance: cells that may stay uncovered.
    """
    chosen = np.empty(len(gains), dtype=np.int64)
    size = 0
    while left > tolerance:
        while True:
            best, best_value = -1, 0.0
            for v in range(len(gains)):
                value = gains[v] * weights[v]
                if value > best_value:
                    best, best_value = v, value
            if best < 0:
                return chosen[:size].copy()
            fresh = count_seen(pointer, tile, mask, missing, best)
            if fresh == gains[best]:
                break
            gains[best] = fresh
        for k in range(pointer[best], pointer[best + 1]):
            missing[tile[k]] &= ~mask[k]
        left -= gains[best]
        gains[best] = 0
        chosen[size] = best
        size += 1
    return chosen[:size].copy()


@njit(cache=True, nogil=True)
def improve_cover(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    allowed: NDArray[np.bool_],
    distances: NDArray[np.float32],
    start: int,
    stops: NDArray[np.int64],
    tolerance: int,
    rounds: int,
) -> NDArray[np.int64]:
    """Shorten a covering tour: reorder it, drop stops that are not needed, move stops to where they cost less.

    A stop may go, or move, when what it alone saw stays seen but for the slack that the tolerance leaves. A stop
    typically moves from the middle of a room, where greedy cover puts it, to the door.

    Returns:
        The new stops in order.
    """
    tour = stops.copy()
    size = len(tour)
    once = np.zeros(len(missing), dtype=np.uint64)
    twice = np.zeros(len(missing), dtype=np.uint64)
    need = np.zeros(len(missing), dtype=np.uint64)
    for _ in range(rounds):
        improve_tour(distances, start, tour[:size])
        recount(pointer, tile, mask, tour, size, once, twice)
        slack = tolerance - count_unseen(missing, once)
        changed = False
        s = 0
        while s < size:
            stop = tour[s]
            before = start if s == 0 else tour[s - 1]
            after = tour[s + 1] if s + 1 < size else -1
            via = distances[before, stop] + (distances[stop, after] if after >= 0 else 0.0)
            alone = seen_by_one(pointer, tile, mask, missing, once, twice, stop, need)
            found = -1
            if alone <= slack or alone == 0:
                found = -2
            else:
                best = via - GAIN
                for v in range(len(allowed)):
                    if not allowed[v] or v == stop:
                        continue
                    length = distances[before, v]
                    if length >= best:
                        continue
                    if after >= 0:
                        length += distances[v, after]
                        if length >= best:
                            continue
                    seen = 0
                    for k in range(pointer[v], pointer[v + 1]):
                        seen += popcount(need[tile[k]] & mask[k])
                    lost = alone - seen
                    if lost <= max(slack, 0):
                        best = length
                        found = v
            for k in range(pointer[stop], pointer[stop + 1]):
                need[tile[k]] = np.uint64(0)
            if found == -1:
                s += 1
                continue
            if found == -2:
                for k in range(s, size - 1):
                    tour[k] = tour[k + 1]
                size -= 1
            else:
                tour[s] = found
                s += 1
            changed = True
            recount(pointer, tile, mask, tour, size, once, twice)
            slack = tolerance - count_unseen(missing, once)
        if not changed:
            break
    improve_tour(distances, start, tour[:size])
    return tour[:size].copy()


@njit(cache=True, nogil=True)
def plan_cover(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    missing: NDArray[np.uint64],
    allowed: NDArray[np.bool_],
    distances: NDArray[np.float32],
    start: int,
    gains: NDArray[np.int64],
    weights: NDArray[np.float64],
    kept: NDArray[np.int64],
    tolerance: int,
    rounds: int,
) -> NDArray[np.int64]:
    """Return a short covering tour from ``start`` that begins from the order ``kept`` (may be empty).

    What the kept stops do not cover is covered greedily, inserted where it costs least, and the whole improved.
    """
    rest = missing.copy()
    remove_seen(pointer, tile, mask, kept, rest)
    total = count_bits(rest)
    chosen = greedy_cover(pointer, tile, mask, rest, gains, weights, total, tolerance)
    stops = insert_all(distances, start, kept, chosen)
    return improve_cover(pointer, tile, mask, missing, allowed, distances, start, stops, tolerance, rounds)


@njit(cache=True, nogil=True)
def take_along(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    extra: NDArray[np.uint64],
    allowed: NDArray[np.bool_],
    distances: NDArray[np.float32],
    start: int,
    stops: NDArray[np.int64],
    detour: float,
) -> NDArray[np.int64]:
    """Add stops to a tour that see what need not be seen, where they lie on the way.

    The stop that sees most for each metre that it adds, one metre more being the price of any, comes first.

    Args:
        pointer: sparse visibility rows, see `Visibility`.
        tile: likewise.
        mask: likewise.
        extra: tile words of what is worth a stop on the way; what the new tour sees of it is removed.
        allowed: viewpoints that may be added, shape (n,).
        distances: metres between viewpoints, shape (n, n); from and to `start` and all stops at least.
        start: where the tour begins.
        stops: the tour, in order.
        detour: metres that one stop may add to the tour, each time.

    Returns:
        The new stops in order.
    """
    tour = np.empty(len(stops) + len(allowed), dtype=np.int64)
    size = len(stops)
    copy_values(tour, stops)
    remove_seen(pointer, tile, mask, stops, extra)
    while size < len(tour):
        best, best_value, where = -1, 0.0, 0
        for v in range(len(allowed)):
            if not allowed[v]:
                continue
            seen = count_seen(pointer, tile, mask, extra, v)
            if seen == 0:
                continue
            for k in range(size):
                before = start if k == 0 else tour[k - 1]
                added = distances[before, v] + distances[v, tour[k]] - distances[before, tour[k]]
                if added <= detour and seen > best_value * (1.0 + added):
                    best, best_value, where = v, seen / (1.0 + added), k
        if best < 0:
            break
        for k in range(size, where, -1):
            tour[k] = tour[k - 1]
        tour[where] = best
        size += 1
        for k in range(pointer[best], pointer[best + 1]):
            extra[tile[k]] &= ~mask[k]
    return tour[:size].copy()
