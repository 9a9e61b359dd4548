"""The eight symmetries of the lattice: a planner's world has no up and no left, so each transition serves eight times.

Symmetry s turns by (s mod 4) quarter turns counter-clockwise, after mirroring x when s >= 4. Symmetry 0 is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.jit import njit
from common.messages.experience import ExpertLabels
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, ObservationBatch
from learner.algorithm.batch import TransitionBatch

SYMMETRIES = 8


def _matrices() -> NDArray[np.int64]:
    quarter = np.array([[0, -1], [1, 0]])
    mirror = np.array([[-1, 0], [0, 1]])
    turns = [np.linalg.matrix_power(quarter, s % 4) for s in range(SYMMETRIES)]
    return np.stack([turn @ mirror if s >= 4 else turn for s, turn in enumerate(turns)])


def _bit_permutations() -> NDArray[np.int64]:
    """Return the bit to which each symmetry moves each edge bit, shape (8, 20)."""
    place = {(int(dx), int(dy)): k for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS)}
    moved = np.einsum("sij,kj->ski", MATRICES, NEIGHBOUR_OFFSETS.astype(np.int64))
    return np.array([[place[int(dx), int(dy)] for dx, dy in row] for row in moved])


MATRICES = _matrices()
"""Matrix of each symmetry: new (dx, dy) = matrix @ (dx, dy), int64, shape (8, 2, 2)."""
BITS = _bit_permutations()


def transform_observations(
    batch: ObservationBatch, symmetries: NDArray[np.int64]
) -> tuple[ObservationBatch, NDArray[np.int32]]:
    """Apply one symmetry to each observation.

    Args:
        batch: k observations.
        symmetries: 0 .. 7, shape (k,).

    Returns:
        The observations, row-major again, and the new node number of every old viewpoint, shape (sum of count,).
        A target keeps its number; target links come out ascending.
    """
    total = len(batch.edges)
    moved = ObservationBatch(
        count=batch.count,
        offsets=np.empty_like(batch.offsets),
        utility=np.empty_like(batch.utility),
        visited=np.empty_like(batch.visited),
        beacon=np.empty_like(batch.beacon),
        edges=np.empty_like(batch.edges),
        robot=np.empty_like(batch.robot),
        has_target=batch.has_target,
        target_known=batch.target_known,
        target_offset=np.empty_like(batch.target_offset),
        link_count=batch.link_count,
        target_links=np.empty_like(batch.target_links),
    )
    numbers = np.empty(total, dtype=np.int32)
    _transform(
        symmetries,
        MATRICES,
        BITS,
        batch.count,
        batch.link_count,
        (batch.offsets, batch.utility, batch.visited, batch.beacon, batch.edges),
        (moved.offsets, moved.utility, moved.visited, moved.beacon, moved.edges),
        (batch.robot, batch.target_offset, batch.target_links),
        (moved.robot, moved.target_offset, moved.target_links),
        numbers,
    )
    return moved, numbers


def augment(batch: TransitionBatch, rng: np.random.Generator) -> TransitionBatch:
    """Draw one symmetry for each transition and apply it to both observations, the choices and the labels."""
    return transform_transitions(batch, rng.integers(SYMMETRIES, size=len(batch)))


def transform_transitions(batch: TransitionBatch, symmetries: NDArray[np.int64]) -> TransitionBatch:
    """Apply one symmetry, 0 .. 7, to each transition; shape of ``symmetries`` (k,)."""
    observations, numbers = transform_observations(batch.observations, symmetries)
    next_observations, next_numbers = transform_observations(batch.next_observations, symmetries)
    return replace(
        batch,
        observations=observations,
        next_observations=next_observations,
        beacons=_renumber(batch.beacons, numbers, observations.count),
        waypoints=_renumber(batch.waypoints, numbers, observations.count),
        labels=_transform_labels(batch.labels, batch.observations, symmetries, numbers),
        next_labels=_transform_labels(batch.next_labels, batch.next_observations, symmetries, next_numbers),
    )


def _transform_labels(
    labels: ExpertLabels | None,
    observations: ObservationBatch,
    symmetries: NDArray[np.int64],
    numbers: NDArray[np.int32],
) -> ExpertLabels | None:
    """Reorder the costs as the waypoints are, and renumber the beacons; ``observations`` are those of before."""
    if labels is None:
        return None
    cost = np.empty_like(labels.cost)
    _permute_costs(
        symmetries,
        BITS,
        observations.count,
        observations.edges,
        observations.robot,
        _target_in_reach(observations),
        labels.cost,
        cost,
    )
    return ExpertLabels(cost=cost, beacon=_renumber(labels.beacon, numbers, observations.count))


def _renumber(nodes: NDArray[np.int32], numbers: NDArray[np.int32], count: NDArray[np.int32]) -> NDArray[np.int32]:
    """Map one node number per observation; -1 and the target stay."""
    first = np.cumsum(count) - count
    inside = (nodes >= 0) & (nodes < count)
    return np.where(inside, numbers[first + np.where(inside, nodes, 0)], nodes).astype(np.int32)


def _target_in_reach(batch: ObservationBatch) -> NDArray[np.bool_]:
    """Whether the target is the last waypoint: known, and linked to the robot's viewpoint."""
    owner = np.repeat(np.arange(len(batch)), batch.link_count)
    linked = np.zeros(len(batch), dtype=np.bool_)
    linked[owner[batch.target_links == batch.robot[owner]]] = True
    return linked & batch.target_known


@njit(cache=True, nogil=True)
def _transform(symmetries, matrices, bits, count, link_count, columns, moved, singles, moved_singles, numbers):  # type: ignore[no-untyped-def]
    offsets, utility, visited, beacon, edges = columns
    new_offsets, new_utility, new_visited, new_beacon, new_edges = moved
    robot, target_offset, links = singles
    new_robot, new_target_offset, new_links = moved_singles
    first = 0
    link = 0
    for g in range(len(count)):
        matrix, permutation = matrices[symmetries[g]], bits[symmetries[g]]
        n, last = count[g], first + count[g]
        x = np.empty(n, dtype=np.int64)
        y = np.empty(n, dtype=np.int64)
        for i in range(n):
            dx, dy = offsets[first + i, 0], offsets[first + i, 1]
            x[i] = matrix[0, 0] * dx + matrix[0, 1] * dy
            y[i] = matrix[1, 0] * dx + matrix[1, 1] * dy
        order = np.argsort(y * np.int64(1 << 20) + x)
        for place in range(n):
            i = order[place]
            numbers[first + i] = place
            new_offsets[first + place, 0] = x[i]
            new_offsets[first + place, 1] = y[i]
            new_utility[first + place] = utility[first + i]
            new_visited[first + place] = visited[first + i]
            new_beacon[first + place] = beacon[first + i]
            mask = np.uint32(0)
            for k in range(NEIGHBOUR_COUNT):
                if (edges[first + i] >> np.uint32(k)) & np.uint32(1):
                    mask |= np.uint32(1) << np.uint32(permutation[k])
            new_edges[first + place] = mask
        new_robot[g] = numbers[first + robot[g]]
        for axis in range(2):
            new_target_offset[g, axis] = matrix[axis, 0] * target_offset[g, 0] + matrix[axis, 1] * target_offset[g, 1]
        for m in range(link, link + link_count[g]):
            new_links[m] = numbers[first + links[m]]
        new_links[link : link + link_count[g]].sort()
        first = last
        link += link_count[g]


@njit(cache=True, nogil=True)
def _permute_costs(symmetries, bits, count, edges, robot, target_in_reach, cost, moved):  # type: ignore[no-untyped-def]
    by_bit = np.empty(NEIGHBOUR_COUNT, dtype=np.float32)
    first = 0
    at = 0
    for g in range(len(count)):
        mask = edges[first + robot[g]]
        start = at
        used = np.zeros(NEIGHBOUR_COUNT, dtype=np.bool_)
        for k in range(NEIGHBOUR_COUNT):
            if (mask >> np.uint32(k)) & np.uint32(1):
                by_bit[bits[symmetries[g], k]] = cost[at]
                used[bits[symmetries[g], k]] = True
                at += 1
        place = start
        for k in range(NEIGHBOUR_COUNT):
            if used[k]:
                moved[place] = by_bit[k]
                place += 1
        if target_in_reach[g]:
            moved[at] = cost[at]
            at += 1
        first += count[g]
