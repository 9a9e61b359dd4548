"""What an observation from the bus must obey beyond its dtypes: one numba sweep, a few microseconds each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.observations.index import waypoint_counts
from common.observations.observation import (
    MAX_DEGREE,
    MAX_EDGE_LENGTH,
    MAX_EDGES,
    MAX_OFFSET,
    MAX_ROUTE,
    MAX_TARGET_LINKS,
    MAX_VIEWPOINTS,
    STEP_UNITS,
    ObservationBatch,
)
from common.system.jit import njit

# Field and problem of each code that the kernels return; {0} is the step, {1} the viewpoint, edge or link within it.
_PROBLEMS = {
    1: ("offsets", f"must stay within {MAX_OFFSET} lattice steps; observation {{0}}, viewpoint {{1}} does not"),
    2: ("robot", "must be a viewpoint of its observation; that of observation {0} is not"),
    3: ("robot", "must be at offset (0, 0); that of observation {0} is not"),
    4: ("edge_count", "must be the sum of the degrees; that of observation {0} is not"),
    5: ("neighbours", "must be viewpoints with a higher number; edge {1} of observation {0} leads elsewhere"),
    6: ("neighbours", "must ascend strictly within a viewpoint; edge {1} of observation {0} does not"),
    7: (
        "neighbours",
        f"must give a viewpoint {MAX_DEGREE} neighbours at most, lower ones included; "
        "observation {0}, viewpoint {1} has more",
    ),
    8: ("bent", "must be edges of their observation; entry {1} of observation {0} is not"),
    9: ("bent", "must ascend strictly; entry {1} of observation {0} does not"),
    10: (
        "bent_length",
        f"must be from the straight distance to {MAX_EDGE_LENGTH:g} lattice steps; entry {{1}} of observation {{0}} "
        "is not",
    ),
    11: ("target_known", "needs a target; observation {0} has none"),
    12: ("target_offset", "must be finite and within {1} lattice steps; that of observation {0} is not"),
    13: ("target_offset", "must be (0, 0) without a target; that of observation {0} is not"),
    14: ("link_count", "must be 0 without a target; that of observation {0} is not"),
    15: ("target_links", "must be viewpoints of their observation; link {1} of observation {0} is not"),
    16: ("target_links", "must not repeat; link {1} of observation {0} does"),
    17: ("route", "must be viewpoints of their observation, the robot's left out; entry {1} of observation {0} is not"),
    18: ("cell", "must be above 0 and at most half a lattice step; that of observation {0} is not"),
    19: ("reach", f"must be above 0 and at most {MAX_OFFSET} lattice steps; that of observation {{0}} is not"),
}
_CHOICE_PROBLEMS = {
    1: ("beacons", "must be beacons of their observation; node {1} at step {0} is not"),
    2: ("waypoints", "must be neighbours of the robot; node {1} at step {0} is not"),
    3: ("labels.beacon", "must be -1 or a beacon of its observation; node {1} at step {0} is not"),
}
_LARGEST_OFFSET = MAX_OFFSET * STEP_UNITS
# Lattice steps: a spacing holds two cells at least; the rest is for the rounding of float32.
_LARGEST_CELL = 0.5001
_TARGET_BOUND = 2 * MAX_OFFSET
# Lattice steps. Each end of an edge lies up to half a unit from its place along both axes, so the straight distance is
# known this well; the rest is for the rounding of float32.
_LENGTH_TOLERANCE = 1.5 / STEP_UNITS


def first_outside(values: NDArray[Any], smallest: float, largest: float) -> int:
    """Return the place of the first number that is not from ``smallest`` to ``largest``, -1 without one; NaN is not."""
    kind = values.dtype.type
    return _first_outside(values, kind(smallest), kind(largest))


def check_observations(batch: ObservationBatch, path: str) -> None:
    """Check that every observation of a batch is what `common.observations.observation` describes.

    The dtypes must be right already.

    Args:
        batch: columns of one or more observations.
        path: what the paths in errors start with.

    Raises:
        MessageError: naming the field, the observation and the viewpoint.
    """
    for name, what, came, fewest, most in (
        ("count", "viewpoints", batch.utility, 1, MAX_VIEWPOINTS),
        ("edge_count", "neighbours", batch.neighbours, 0, MAX_EDGES),
        ("bent_count", "bent edges", batch.bent, 0, MAX_EDGES),
        ("link_count", "links", batch.target_links, 0, MAX_TARGET_LINKS),
        ("route_count", "viewpoints on routes", batch.route, 0, MAX_ROUTE),
    ):
        counts: NDArray[np.int32] = getattr(batch, name)
        total = _total(counts, fewest, most)
        if total < 0 or len(counts) == 0:
            raise MessageError(f"{path}.{name}", f"must hold at least one number from {fewest} to {most}, and no other")
        if total != len(came):
            raise MessageError(f"{path}.{name}", f"must add up to the {len(came)} {what} that came")
    code, step, place = _sweep(
        (batch.count, batch.offsets, batch.robot),
        (batch.degree, batch.edge_count, batch.neighbours),
        (batch.bent_count, batch.bent, batch.bent_length),
        (batch.has_target, batch.target_known, batch.target_offset, batch.link_count, batch.target_links),
        (batch.cell, batch.reach, batch.route_count, batch.route),
    )
    if code:
        field, problem = _PROBLEMS[code]
        raise MessageError(f"{path}.{field}", problem.format(step, place))


def check_choices(
    batch: ObservationBatch,
    beacons: NDArray[np.int32],
    waypoints: NDArray[np.int32],
    expert_beacons: NDArray[np.int32] | None,
    path: str,
) -> int:
    """Check the decisions that were made in the first observations of a valid batch.

    Args:
        batch: at least as many valid observations as decisions.
        beacons: chosen beacon of each decision, shape (k,).
        waypoints: chosen waypoint of each decision, shape (k,).
        expert_beacons: the expert's beacon of each decision or -1, shape (k,), or None without labels.
        path: what the paths in errors start with.

    Returns:
        The number of waypoint choices of all k decisions together.

    Raises:
        MessageError: naming the field and the step.
    """
    expert = np.full(len(beacons), -1, dtype=np.int32) if expert_beacons is None else expert_beacons
    code, step, node = _sweep_choices(
        batch.count,
        batch.degree,
        batch.edge_count,
        batch.neighbours,
        batch.beacon,
        batch.robot,
        batch.target_known,
        batch.link_count,
        batch.target_links,
        beacons,
        waypoints,
        expert,
    )
    if code:
        field, problem = _CHOICE_PROBLEMS[code]
        raise MessageError(f"{path}.{field}", problem.format(step, node))
    return int(waypoint_counts(batch)[: len(beacons)].sum())


@njit(cache=True, nogil=True)
def _sweep(graphs, edges, ways, targets, routes) -> Any:  # type: ignore[no-untyped-def]
    """Return (code, observation, place) of the first violation, code 0 without one."""
    count, offsets, robot = graphs
    degree, edge_count, neighbours = edges
    bent_count, bent, bent_length = ways
    has_target, target_known, target_offset, link_count, target_links = targets
    cell, reach, route_count, route = routes
    all_degrees = np.empty(count.max(), dtype=np.int32)
    first = 0
    edge = 0
    way = 0
    link = 0
    on_route = 0
    for step in range(len(count)):
        n = count[step]
        places, higher = offsets[first : first + n], degree[first : first + n]
        degrees = 0
        for i in range(n):
            if abs(np.int64(places[i, 0])) > _LARGEST_OFFSET:
                return 1, step, i
            if abs(np.int64(places[i, 1])) > _LARGEST_OFFSET:
                return 1, step, i
            degrees += higher[i]
            all_degrees[i] = higher[i]
        if robot[step] < 0 or robot[step] >= n:
            return 2, step, 0
        if places[robot[step], 0] != 0 or places[robot[step], 1] != 0:
            return 3, step, 0
        if degrees != edge_count[step]:
            return 4, step, 0
        for a in range(way, way + bent_count[step]):
            if bent[a] >= edge_count[step]:
                return 8, step, a - way
            if a > way and bent[a] <= bent[a - 1]:
                return 9, step, a - way
        first_edge = edge
        first_way = way
        last_way = way + bent_count[step]
        next_bent = np.int64(bent[way]) if way < last_way else np.int64(-1)
        for i in range(n):
            lower = np.int64(i)
            for e in range(edge, edge + higher[i]):
                j = np.int64(neighbours[np.uint64(e)])
                if j <= i or j >= n:
                    return 5, step, e - first_edge
                if j <= lower:
                    return 6, step, e - first_edge
                lower = j
                all_degrees[np.uint64(j)] += 1
                if e - first_edge == next_bent:
                    dx = (np.int64(places[i, 0]) - places[j, 0]) / STEP_UNITS
                    dy = (np.int64(places[i, 1]) - places[j, 1]) / STEP_UNITS
                    shortest = math.sqrt(dx * dx + dy * dy) - _LENGTH_TOLERANCE
                    length = bent_length[way]
                    # Written so that NaN fails.
                    if not (length > 0.0 and shortest <= length <= MAX_EDGE_LENGTH):
                        return 10, step, way - first_way
                    way += 1
                    next_bent = np.int64(bent[way]) if way < last_way else np.int64(-1)
            edge += higher[i]
        for i in range(n):
            if all_degrees[i] > MAX_DEGREE:
                return 7, step, i
        x, y = target_offset[step, 0], target_offset[step, 1]
        if not (abs(x) <= _TARGET_BOUND and abs(y) <= _TARGET_BOUND):
            return 12, step, _TARGET_BOUND
        if not has_target[step]:
            if target_known[step]:
                return 11, step, 0
            if x != 0 or y != 0:
                return 13, step, 0
            if link_count[step] != 0:
                return 14, step, 0
        for a in range(link_count[step]):
            if target_links[link + a] >= n:
                return 15, step, a
            for b in range(a):
                if target_links[link + a] == target_links[link + b]:
                    return 16, step, a
        for a in range(route_count[step]):
            if route[on_route + a] >= n or route[on_route + a] == robot[step]:
                return 17, step, a
        # Written so that NaN fails.
        if not 0.0 < cell[step] <= _LARGEST_CELL:
            return 18, step, 0
        if not 0.0 < reach[step] <= MAX_OFFSET:
            return 19, step, 0
        link += link_count[step]
        on_route += route_count[step]
        first += n
    return 0, 0, 0


@njit(cache=True, nogil=True)
def _sweep_choices(  # type: ignore[no-untyped-def]
    count,
    degree,
    edge_count,
    neighbours,
    beacon,
    robot,
    target_known,
    link_count,
    target_links,
    beacons,
    waypoints,
    expert,
) -> Any:
    """Return (code, step, node) of the first violation, code 0 without one."""
    first = 0
    edge = 0
    link = 0
    for step in range(len(beacons)):
        n = count[step]
        for role in range(2):
            node = beacons[step] if role == 0 else expert[step]
            known = 0 <= node < n and beacon[first + node]
            target = node == n and target_known[step]
            nothing = role == 1 and node == -1
            if not (known or target or nothing):
                return (1 if role == 0 else 3), step, node
        node = waypoints[step]
        valid = False
        if 0 <= node < n:
            # The lower one of the two lists the other.
            low, high = min(node, robot[step]), max(node, robot[step])
            start = edge
            for i in range(low):
                start += degree[first + i]
            for e in range(start, start + degree[first + low]):
                valid = valid or neighbours[e] == high
        elif node == n and target_known[step]:
            for a in range(link, link + link_count[step]):
                valid = valid or target_links[a] == robot[step]
        if not valid:
            return 2, step, node
        first += n
        edge += edge_count[step]
        link += link_count[step]
    return 0, 0, 0


@njit(cache=True, nogil=True)
def _first_outside(values: NDArray[Any], smallest: float, largest: float) -> int:
    for place in range(len(values)):
        # Written so that NaN fails.
        if not smallest <= values[place] <= largest:
            return place
    return -1


@njit(cache=True, nogil=True)
def _total(counts: NDArray[np.int32], fewest: int, most: int) -> int:
    """Return the sum of all counts, -1 when one is not from ``fewest`` to ``most``."""
    total = 0
    for count in counts:
        if not fewest <= count <= most:
            return -1
        total += count
    return total
