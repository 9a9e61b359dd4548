"""What an observation from the bus must obey beyond its dtypes: one numba sweep, a few microseconds each."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.jit import njit
from common.observation import MAX_OFFSET, MAX_TARGET_LINKS, MAX_VIEWPOINTS, NEIGHBOUR_COUNT, ObservationBatch
from common.observation_index import NEIGHBOUR_BITS

# Field and problem of each code that the kernels return; {0} is the step, {1} the viewpoint (or link) within it.
_PROBLEMS = {
    1: ("offsets", f"must stay within {MAX_OFFSET} lattice steps; observation {{0}}, viewpoint {{1}} does not"),
    2: ("offsets", "must be strictly row-major (by dy, then dx); observation {0} is not at viewpoint {1}"),
    3: ("robot", "must be a viewpoint of its observation; that of observation {0} is not"),
    4: ("robot", "must stand at offset (0, 0); that of observation {0} does not"),
    5: ("edges", f"must be below 2**{NEIGHBOUR_COUNT}; observation {{0}}, viewpoint {{1}} is not"),
    6: ("edges", "must lead to viewpoints; one of observation {0}, viewpoint {1} leads nowhere"),
    7: ("edges", "must be symmetric; one of observation {0}, viewpoint {1} has no way back"),
    8: ("target_known", "needs a target; observation {0} has none"),
    9: ("target_offset", "must be finite and within {1} lattice steps; that of observation {0} is not"),
    10: ("target_offset", "must be (0, 0) without a target; that of observation {0} is not"),
    11: ("link_count", "must be 0 without a target; that of observation {0} is not"),
    12: ("target_links", "must be viewpoints of their observation; link {1} of observation {0} is not"),
    13: ("target_links", "must not repeat; link {1} of observation {0} does"),
}
_CHOICE_PROBLEMS = {
    1: ("beacons", "must be beacons of their observation; node {1} at step {0} is not"),
    2: ("waypoints", "must be neighbours of the robot; node {1} at step {0} is not"),
    3: ("labels.beacon", "must be -1 or a beacon of its observation; node {1} at step {0} is not"),
}
_TARGET_BOUND = 2 * MAX_OFFSET


def check_observations(batch: ObservationBatch, path: str) -> None:
    """Check that every observation of a batch is what `common.observation` describes.

    The dtypes must be right already.

    Args:
        batch: columns of one or more observations.
        path: what the paths in errors start with.

    Raises:
        MessageError: naming the field, the observation and the viewpoint.
    """
    count, total = batch.count, len(batch.utility)
    if len(count) == 0 or int(count.min()) < 1 or int(count.max()) > MAX_VIEWPOINTS:
        raise MessageError(f"{path}.count", f"must hold at least one number from 1 to {MAX_VIEWPOINTS}")
    if int(count.sum(dtype=np.int64)) != total:
        raise MessageError(f"{path}.count", f"must add up to the {total} viewpoints that came")
    links = batch.link_count
    if int(links.min()) < 0 or int(links.max()) > MAX_TARGET_LINKS:
        raise MessageError(f"{path}.link_count", f"must hold numbers from 0 to {MAX_TARGET_LINKS}")
    if int(links.sum(dtype=np.int64)) != len(batch.target_links):
        raise MessageError(f"{path}.link_count", f"must add up to the {len(batch.target_links)} links that came")
    code, step, place = _sweep(
        count,
        batch.offsets,
        batch.edges,
        batch.robot,
        batch.has_target,
        batch.target_known,
        batch.target_offset,
        links,
        batch.target_links,
        NEIGHBOUR_BITS,
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
    code, step, node, choices = _sweep_choices(
        batch.count,
        batch.offsets,
        batch.edges,
        batch.beacon,
        batch.robot,
        batch.target_known,
        batch.link_count,
        batch.target_links,
        beacons,
        waypoints,
        expert,
        NEIGHBOUR_BITS,
    )
    if code:
        field, problem = _CHOICE_PROBLEMS[code]
        raise MessageError(f"{path}.{field}", problem.format(step, node))
    return int(choices)


@njit(cache=True, nogil=True)
def _sweep(  # type: ignore[no-untyped-def]
    count, offsets, edges, robot, has_target, target_known, target_offset, link_count, target_links, bits
) -> Any:
    """Return (code, observation, place) of the first violation, code 0 without one."""
    row = np.int64(1 << 20)
    keys = np.empty(len(edges), dtype=np.int64)
    seen = np.zeros(len(edges), dtype=np.uint32)
    first = 0
    link = 0
    for step in range(len(count)):
        last = first + count[step]
        for i in range(first, last):
            right, up = np.int64(offsets[i, 0]), np.int64(offsets[i, 1])
            if abs(right) > MAX_OFFSET or abs(up) > MAX_OFFSET:
                return 1, step, i - first
            keys[i] = up * row + right
            if i > first and keys[i] <= keys[i - 1]:
                return 2, step, i - first
            if edges[i] >> np.uint32(NEIGHBOUR_COUNT):
                return 5, step, i - first
        if robot[step] < 0 or robot[step] >= count[step]:
            return 3, step, 0
        if keys[first + robot[step]] != 0:
            return 4, step, 0
        # Every pair is looked at from its row-major first end: three cursors that only move forward.
        for dy in range(3):
            cursor = first
            for i in range(first, last):
                middle = keys[i] + dy * row
                lowest = middle + 1 if dy == 0 else middle - 2
                while cursor < last and keys[cursor] < lowest:
                    cursor += 1
                j = cursor
                while j < last and keys[j] <= middle + 2:
                    bit = bits[dy + 2, keys[j] - middle + 2]
                    if bit >= 0:
                        there = np.uint32(1) << np.uint32(bit)
                        back = np.uint32(1) << np.uint32(NEIGHBOUR_COUNT - 1 - bit)
                        if (edges[i] & there != 0) != (edges[j] & back != 0):
                            return 7, step, (i if edges[i] & there else j) - first
                        seen[i] |= there
                        seen[j] |= back
                    j += 1
        for i in range(first, last):
            if edges[i] & ~seen[i]:
                return 6, step, i - first
        x, y = target_offset[step, 0], target_offset[step, 1]
        if not (abs(x) <= _TARGET_BOUND and abs(y) <= _TARGET_BOUND):
            return 9, step, _TARGET_BOUND
        if not has_target[step]:
            if target_known[step]:
                return 8, step, 0
            if x != 0 or y != 0:
                return 10, step, 0
            if link_count[step] != 0:
                return 11, step, 0
        for a in range(link_count[step]):
            if target_links[link + a] >= count[step]:
                return 12, step, a
            for b in range(a):
                if target_links[link + a] == target_links[link + b]:
                    return 13, step, a
        link += link_count[step]
        first = last
    return 0, 0, 0


@njit(cache=True, nogil=True)
def _sweep_choices(  # type: ignore[no-untyped-def]
    count,
    offsets,
    edges,
    beacon,
    robot,
    target_known,
    link_count,
    target_links,
    beacons,
    waypoints,
    expert,
    bits,
) -> Any:
    """Return (code, step, node, waypoint choices of all steps); code 0 without a violation."""
    first = 0
    link = 0
    choices = 0
    for step in range(len(beacons)):
        n = count[step]
        here = first + robot[step]
        linked = False
        if target_known[step]:
            for a in range(link, link + link_count[step]):
                linked = linked or target_links[a] == robot[step]
        for role in range(2):
            node = beacons[step] if role == 0 else expert[step]
            known = 0 <= node < n and beacon[first + node]
            target = node == n and target_known[step]
            nothing = role == 1 and node == -1
            if not (known or target or nothing):
                return (1 if role == 0 else 3), step, node, 0
        node = waypoints[step]
        valid = node == n and linked
        if 0 <= node < n:
            dx = np.int64(offsets[first + node, 0]) - offsets[here, 0]
            dy = np.int64(offsets[first + node, 1]) - offsets[here, 1]
            if abs(dx) <= 2 and abs(dy) <= 2 and bits[dy + 2, dx + 2] >= 0:
                valid = (edges[here] >> np.uint32(bits[dy + 2, dx + 2])) & np.uint32(1) != 0
        if not valid:
            return 2, step, node, 0
        mask = edges[here]
        while mask:
            mask &= mask - np.uint32(1)
            choices += 1
        choices += 1 if linked else 0
        first += n
        link += link_count[step]
    return 0, 0, 0, choices
