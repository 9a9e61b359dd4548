"""Simulated annealing of covering tours: the cost is the metres until enough has been seen, exactly as it is driven."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.copies import copy_values
from common.system.jit import njit
from common.tours.local_search import insert_cheapest
from common.tours.sighting import popcount

# Metres that every tour counts more which leaves more unseen than the tolerance.
UNFINISHED_PENALTY = 4.0
# Stops that a tour may have, and how many times those of the first one in large worlds.
MAX_STOPS = 256
MAX_GROWTH = 2


@njit(cache=True, nogil=True)
def drive(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    distances: NDArray[np.float32],
    hops: NDArray[np.int32],
    start: int,
    stops: NDArray[np.int64],
    size: int,
    missing: NDArray[np.uint64],
    left: int,
    tolerance: int,
    penalty: float,
    bound: float,
    rest: NDArray[np.uint64],
    passed: NDArray[np.int64],
    stamp: int,
) -> tuple[float, int, bool]:
    """Drive a tour over all nodes on its way, seeing from each, until at most `tolerance` cells are missing.

    Args:
        pointer: sparse visibility rows of the nodes, see `Visibility`.
        tile: likewise.
        mask: likewise.
        distances: metres between all nodes.
        hops: next node on the way from each node to each other.
        start: node where the tour begins.
        stops: nodes to visit in order.
        size: number of stops.
        missing: tile words of the cells that are missing after the scan at the start.
        left: their number.
        tolerance: cells that may stay unseen.
        penalty: metres that a cell counts which is left unseen beyond the tolerance.
        bound: a tour longer than this many metres is given up.
        rest: working space, of the shape of `missing`.
        passed: working space, one number per node, below `stamp` everywhere.
        stamp: marks the nodes of this tour in `passed`.

    Returns:
        Metres, infinite when given up, with penalties when the tour leaves too much unseen; the number of stops that
        were used; whether enough was seen.
    """
    copy_values(rest, missing)
    length = 0.0
    at = start
    for s in range(size):
        while at != stops[s]:
            ahead = hops[at, stops[s]]
            length += distances[at, ahead]
            if length > bound:
                return np.inf, size, False
            at = ahead
            if passed[at] == stamp:
                continue
            passed[at] = stamp
            for k in range(pointer[at], pointer[at + 1]):
                word = rest[tile[k]] & mask[k]
                if word:
                    left -= popcount(word)
                    rest[tile[k]] &= ~mask[k]
            if left <= tolerance:
                return length, s + 1, True
    return length + UNFINISHED_PENALTY + penalty * (left - tolerance), size, False


@njit(cache=True, nogil=True)
def _write(stops: NDArray[np.int64], first: int, length: int, turned: bool, out: NDArray[np.int64], place: int) -> int:
    """Write a part of a tour to a place in another, turned round or not; return the place behind it."""
    for k in range(length):
        out[place + k] = stops[first + length - 1 - k] if turned else stops[first + k]
    return place + length


@njit(cache=True, nogil=True)
def _propose(
    stops: NDArray[np.int64],
    size: int,
    out: NDArray[np.int64],
    start: int,
    distances: NDArray[np.float32],
    useful: NDArray[np.int64],
    near: NDArray[np.int64],
) -> int:
    """Write a random change of the first `size` stops into `out`; return the new number of stops."""
    kind = np.random.random()
    copy_values(out, stops[:size])
    if kind < 0.2 and size > 1:
        # Turn a part of the tour round.
        i = np.random.randint(size)
        j = min(i + 1 + np.random.randint(8 if np.random.random() < 0.7 else size), size - 1)
        for k in range(i, j + 1):
            out[k] = stops[j - (k - i)]
        return size
    if kind < 0.4 and size > 1:
        # Move up to three stops elsewhere, either way round.
        length = min(1 + np.random.randint(3), size - 1)
        first = np.random.randint(size - length + 1)
        where = np.random.randint(size - length + 1)
        turned = np.random.random() < 0.5
        place = 0
        for k in range(size):
            if first <= k < first + length:
                continue
            if place == where:
                place = _write(stops, first, length, turned, out, place)
            out[place] = stops[k]
            place += 1
        if place == where:
            _write(stops, first, length, turned, out, place)
        return size
    if kind < 0.65 and size > 0:
        # Move a stop to a viewpoint near it.
        i = np.random.randint(size)
        row = near[stops[i]]
        out[i] = row[np.random.randint(len(row))]
        return size
    if kind < 0.8 and size > 1:
        i = np.random.randint(size)
        for k in range(i, size - 1):
            out[k] = stops[k + 1]
        return size - 1
    if size >= len(out):
        return size
    # Add a stop where it costs least.
    new = useful[np.random.randint(len(useful))]
    insert_cheapest(distances, start, out, size, new)
    return size + 1


@njit(cache=True, nogil=True)
def anneal(
    pointer: NDArray[np.int64],
    tile: NDArray[np.int32],
    mask: NDArray[np.uint64],
    distances: NDArray[np.float32],
    hops: NDArray[np.int32],
    start: int,
    initial: NDArray[np.int64],
    missing: NDArray[np.uint64],
    left: int,
    tolerance: int,
    useful: NDArray[np.int64],
    near: NDArray[np.int64],
    iterations: int,
    hottest: float,
    coldest: float,
    penalty: float,
    seed: int,
) -> tuple[NDArray[np.int64], float, bool]:
    """Shorten a covering tour by simulated annealing; see `drive` for the arguments that are not named here.

    Args:
        pointer: see `drive`.
        tile: see `drive`.
        mask: see `drive`.
        distances: see `drive`.
        hops: see `drive`.
        start: see `drive`.
        initial: stops of the tour to begin with.
        missing: see `drive`.
        left: see `drive`.
        tolerance: see `drive`.
        useful: nodes that may be added: they see something that is missing.
        near: nodes near each node, to which a stop may move, shape (nodes, any).
        iterations: changes to try.
        hottest: temperature at the start, metres; it falls geometrically.
        coldest: temperature at the end, metres.
        penalty: see `drive`.
        seed: of all chance.

    Returns:
        Stops of the shortest tour that sees enough, and its metres, infinite when none was found; and whether the last
        tour sees enough: if not, the penalty is too small for this world.
    """
    np.random.seed(seed)
    rest = np.empty_like(missing)
    passed = np.zeros(len(distances), dtype=np.int64)
    stamp = 1
    size = len(initial)
    tour = np.empty(max(MAX_STOPS, MAX_GROWTH * size), dtype=np.int64)
    other = np.empty_like(tour)
    copy_values(tour, initial)
    cost, used, done = drive(
        pointer, tile, mask, distances, hops, start, tour, size, missing, left, tolerance, penalty, np.inf, rest,
        passed, stamp,
    )  # fmt: skip
    size, finished = used, done
    best = tour[:size].copy()
    best_cost = cost if done else np.inf
    cooling = (coldest / hottest) ** (1.0 / max(iterations, 1))
    temperature = hottest
    for _ in range(iterations):
        temperature *= cooling
        new_size = _propose(tour, size, other, start, distances, useful, near)
        bound = cost - temperature * np.log(1.0 - np.random.random())
        stamp += 1
        new_cost, used, done = drive(
            pointer, tile, mask, distances, hops, start, other, new_size, missing, left, tolerance, penalty, bound,
            rest, passed, stamp,
        )  # fmt: skip
        if new_cost > bound:
            continue
        cost, size, finished = new_cost, used, done
        tour, other = other, tour
        if done and cost < best_cost - 1e-6:
            best_cost = cost
            best = tour[:size].copy()
    return best, best_cost, finished
