"""Open tours over a few stops: cheapest insertion, then 2-opt and Or-opt moves until none helps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.system.copies import copy_values
from common.system.jit import njit

GAIN = 1e-3


@njit(cache=True, nogil=True)
def tour_length(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64]) -> float:
    """Length of the open tour from ``start`` through ``stops`` in order, metres."""
    total = 0.0
    at = start
    for stop in stops:
        total += distances[at, stop]
        at = stop
    return total


@njit(cache=True, nogil=True)
def insert_cheapest(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64], size: int, new: int) -> None:
    """Insert ``new`` where it lengthens the tour of the first ``size`` stops least; there must be room for it."""
    best = np.inf
    where = size
    for k in range(size + 1):
        before = start if k == 0 else stops[k - 1]
        added = distances[before, new]
        if k < size:
            added += distances[new, stops[k]] - distances[before, stops[k]]
        if added < best:
            best = added
            where = k
    for k in range(size, where, -1):
        stops[k] = stops[k - 1]
    stops[where] = new


@njit(cache=True, nogil=True)
def insert_all(
    distances: NDArray[np.float32], start: int, stops: NDArray[np.int64], new: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the tour with all of ``new`` inserted, one after the other, each where it lengthens the tour least."""
    tour = np.empty(len(stops) + len(new), dtype=np.int64)
    copy_values(tour, stops)
    for k in range(len(new)):
        insert_cheapest(distances, start, tour, len(stops) + k, new[k])
    return tour


@njit(cache=True, nogil=True)
def improve_tour(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64]) -> None:
    """Shorten an open tour in place by 2-opt (reversals) and Or-opt (moves of up to three stops, either way round).

    The end is free. Every move shortens the tour by more than a millimetre, so the loop ends; the result is never
    longer than what came in.
    """
    legs = np.empty(len(stops), dtype=np.float32)
    _legs(distances, start, stops, legs)
    for _ in range(64):
        changed = _two_opt(distances, start, stops, legs)
        changed |= len(stops) > 1 and _or_opt(distances, start, stops, legs)
        if not changed:
            break


@njit(cache=True, nogil=True)
def _legs(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64], legs: NDArray[np.float32]) -> None:
    """Write the length of the leg that leads to each stop."""
    at = start
    for k in range(len(stops)):
        legs[k] = distances[at, stops[k]]
        at = stops[k]


@njit(cache=True, nogil=True)
def _two_opt(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64], legs: NDArray[np.float32]) -> bool:
    n = len(stops)
    changed = False
    for i in range(n - 1):
        from_before = distances[start if i == 0 else stops[i - 1]]
        from_first = distances[stops[i]]
        for j in range(i + 1, n):
            old = legs[i]
            if j < n - 1:
                old += legs[j + 1]
            new = from_before[stops[j]]
            # The other new leg only adds to this one.
            if new >= old:
                continue
            if j < n - 1:
                new += from_first[stops[j + 1]]
            if new < old - GAIN:
                a, b = i, j
                while a < b:
                    stops[a], stops[b] = stops[b], stops[a]
                    a += 1
                    b -= 1
                _legs(distances, start, stops, legs)
                from_first = distances[stops[i]]
                changed = True
    return changed


@njit(cache=True, nogil=True)
def _or_opt(distances: NDArray[np.float32], start: int, stops: NDArray[np.int64], legs: NDArray[np.float32]) -> bool:
    n = len(stops)
    changed = False
    segment = np.empty(3, dtype=np.int64)
    # The tour without the segment, and its legs; gap k lies before stop k of it.
    rest = np.empty(n, dtype=np.int64)
    rest_legs = np.empty(n, dtype=np.float32)
    for length in range(1, min(3, n - 1) + 1):
        for i in range(n - length + 1):
            before = start if i == 0 else stops[i - 1]
            head = stops[i]
            tail = stops[i + length - 1]
            saved = legs[i]
            if i + length < n:
                after = stops[i + length]
                saved += legs[i + length] - distances[before, after]
            # No gap takes the segment for less than nothing, as path lengths obey the triangle inequality.
            if not saved > GAIN:
                continue
            copy_values(rest, stops[:i])
            copy_values(rest_legs, legs[:i])
            copy_values(rest[i:], stops[i + length : n])
            copy_values(rest_legs[i:], legs[i + length : n])
            from_head, from_tail = distances[head], distances[tail]
            span = from_head[tail]
            best = GAIN
            where = -1
            turned = False
            left = start
            for k in range(n - length + 1):
                straight, reverse = from_head[left], from_tail[left]
                if k < n - length:
                    right = rest[k]
                    between = rest_legs[k]
                    left = right
                    # By the same inequality the gap costs at least so much.
                    if k == i or 2.0 * (straight - between) - span >= saved - best:
                        continue
                    straight += from_tail[right] - between
                    reverse += from_head[right] - between
                elif k == i:
                    continue
                if saved - straight > best:
                    best, where, turned = saved - straight, k, False
                if saved - reverse > best:
                    best, where, turned = saved - reverse, k, True
            if where < 0:
                continue
            for k in range(length):
                segment[k] = stops[i + length - 1 - k] if turned else stops[i + k]
            copy_values(stops, rest[:where])
            copy_values(stops[where:], segment[:length])
            copy_values(stops[where + length :], rest[where : n - length])
            _legs(distances, start, stops, legs)
            changed = True
    return changed
