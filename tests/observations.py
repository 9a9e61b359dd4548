"""Random valid observations for tests and benchmarks: connected lattice graphs with ragged edges."""

from __future__ import annotations

from typing import Literal

import numpy as np
from hypothesis import strategies as st

from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, Observation, ObservationBatch

Target = Literal["none", "unknown", "known"]
TARGETS: tuple[Target, ...] = ("none", "unknown", "known")


def random_observation(
    rng: np.random.Generator,
    viewpoints: int = 30,
    target: Target = "none",
    useful: float = 0.3,
    edge_share: float = 0.6,
) -> Observation:
    """Grow a connected graph of ``viewpoints`` lattice points around a robot.

    Args:
        rng: source of chance.
        viewpoints: number of viewpoints, at least 2, so that the robot always has a neighbour.
        target: no target, one that is not known free yet, or a known one.
        useful: share of viewpoints with a utility; at least one has it and is a beacon.
        edge_share: share of the possible edges that are kept beside a spanning tree.
    """
    points, tree = _grow(rng, viewpoints)
    order = np.lexsort((points[:, 0], points[:, 1]))
    points = points[order]
    number = {(int(x), int(y)): i for i, (x, y) in enumerate(points)}
    edges = np.zeros(viewpoints, dtype=np.uint32)
    for (ax, ay), (bx, by) in tree:
        _connect(edges, number, (ax, ay), (bx, by))
    for x, y in points:
        for k in range(NEIGHBOUR_COUNT // 2, NEIGHBOUR_COUNT):
            other = (int(x + NEIGHBOUR_OFFSETS[k, 0]), int(y + NEIGHBOUR_OFFSETS[k, 1]))
            if other in number and rng.random() < edge_share:
                _connect(edges, number, (int(x), int(y)), other)
    robot = int(rng.integers(viewpoints))
    utility = np.where(rng.random(viewpoints) < useful, rng.integers(2, 80, viewpoints), 0).astype(np.uint16)
    utility[rng.integers(viewpoints)] = 7
    beacon = (utility > 0) & (rng.random(viewpoints) < 0.3)
    beacon[np.flatnonzero(utility)[0]] = True
    visited = rng.random(viewpoints) < 0.3
    visited[robot] = True
    offsets = (points - points[robot]).astype(np.int16)
    target_offset = np.zeros(2, dtype=np.float32)
    links = np.zeros(0, dtype=np.uint16)
    if target == "unknown":
        target_offset = rng.uniform(-30, 30, 2).astype(np.float32)
        links = np.flatnonzero(beacon)[:20].astype(np.uint16)
    elif target == "known":
        anchor = offsets[int(rng.integers(viewpoints))]
        target_offset = (anchor + rng.uniform(-0.5, 0.5, 2)).astype(np.float32)
        distance = np.hypot(*(offsets - target_offset).T)
        links = np.sort(np.argsort(distance, kind="stable")[: int(rng.integers(1, 13))]).astype(np.uint16)
    return Observation(
        offsets=offsets,
        utility=utility,
        visited=visited,
        beacon=beacon,
        edges=edges,
        robot=robot,
        has_target=target != "none",
        target_known=target == "known",
        target_offset=target_offset,
        target_links=links,
    )


def random_batch(
    rng: np.random.Generator,
    count: int,
    viewpoints: tuple[int, int] = (2, 40),
    targets: tuple[Target, ...] = TARGETS,
) -> ObservationBatch:
    """Stack ``count`` random observations with sizes drawn from the range ``viewpoints``, both ends included."""
    return ObservationBatch.stack(
        [
            random_observation(
                rng, int(rng.integers(viewpoints[0], viewpoints[1] + 1)), targets[rng.integers(len(targets))]
            )
            for _ in range(count)
        ]
    )


def observations(max_viewpoints: int = 40) -> st.SearchStrategy[Observation]:
    """Strategy of random observations of all kinds, the smallest graphs included."""
    return st.builds(
        lambda seed, viewpoints, target, useful, share: random_observation(
            np.random.default_rng(seed), viewpoints, target, useful, share
        ),
        st.integers(0, 2**32 - 1),
        st.integers(2, max_viewpoints),
        st.sampled_from(TARGETS),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
    )


def _grow(rng: np.random.Generator, count: int) -> tuple[np.ndarray, list[tuple[tuple[int, int], tuple[int, int]]]]:
    """Grow ``count`` lattice points from the origin by random walks; return them and the edges of growth."""
    points = [(0, 0)]
    taken = {(0, 0)}
    tree = []
    while len(points) < count:
        here = points[int(rng.integers(len(points)))]
        step = NEIGHBOUR_OFFSETS[int(rng.integers(NEIGHBOUR_COUNT))]
        there = (here[0] + int(step[0]), here[1] + int(step[1]))
        if there not in taken:
            taken.add(there)
            points.append(there)
            tree.append((here, there))
    return np.array(points, dtype=np.int64), tree


def _connect(edges: np.ndarray, number: dict[tuple[int, int], int], a: tuple[int, int], b: tuple[int, int]) -> None:
    """Set the bit of the edge at both ends."""
    step = (b[0] - a[0], b[1] - a[1])
    k = next(k for k in range(NEIGHBOUR_COUNT) if tuple(NEIGHBOUR_OFFSETS[k]) == step)
    edges[number[a]] |= np.uint32(1 << k)
    edges[number[b]] |= np.uint32(1 << (NEIGHBOUR_COUNT - 1 - k))
