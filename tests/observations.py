"""Random valid observations for tests and benchmarks: connected graphs with ragged edges."""

from __future__ import annotations

from typing import Literal

import numpy as np
from hypothesis import strategies as st

from common.observations.observation import (
    IMAGE_SIDE,
    IMAGES,
    MAX_TARGET_LINKS,
    STEP_UNITS,
    Observation,
    ObservationBatch,
)

Target = Literal["none", "unknown", "known"]
TARGETS: tuple[Target, ...] = ("none", "unknown", "known")

# Squares whose viewpoints may be joined: the 5 x 5 block without its corners.
_BLOCK = np.array([(dx, dy) for dy in range(-2, 3) for dx in range(-2, 3) if abs(dx) + abs(dy) < 4])


def random_observation(
    rng: np.random.Generator,
    viewpoints: int = 30,
    target: Target = "none",
    useful: float = 0.3,
    edge_share: float = 0.6,
    *,
    lattice: bool = False,
    bent_share: float = 0.1,
    image: bool = False,
) -> Observation:
    """Grow a connected graph of ``viewpoints`` viewpoints around a robot.

    Args:
        rng: source of chance.
        viewpoints: number of viewpoints, at least 2, so that the robot always has a neighbour.
        target: no target, one that is not known free yet, or a known one.
        useful: share of viewpoints with a utility; at least one has it and is a beacon.
        edge_share: share of the possible edges that are kept beside a spanning tree.
        lattice: one viewpoint per lattice square, in its middle, and straight edges; otherwise viewpoints lie anywhere,
            some squares have several, and some edges are bent.
        bent_share: share of edges that are longer than the straight line, unless on a lattice.
        image: with a random image of the belief.
    """
    squares, tree = _grow(rng, viewpoints, lattice)
    places = squares * STEP_UNITS
    if not lattice:
        places += rng.integers(-STEP_UNITS // 2, STEP_UNITS // 2, places.shape)
    joined = np.abs(squares[:, None] - squares).sum(axis=2) < 4
    joined &= np.abs(squares[:, None] - squares).max(axis=2) < 3
    joined &= rng.random(joined.shape) < edge_share
    joined[tuple(tree.T)] = True
    ends = np.argwhere(np.triu(joined, 1))
    straight = np.hypot(*(places[ends[:, 0]] - places[ends[:, 1]]).T) / STEP_UNITS
    bent = np.flatnonzero(rng.random(len(ends)) < (0.0 if lattice else bent_share))
    robot = int(rng.integers(viewpoints))
    utility = np.where(rng.random(viewpoints) < useful, rng.integers(2, 80, viewpoints), 0).astype(np.uint16)
    utility[rng.integers(viewpoints)] = 7
    beacon = (utility > 0) & (rng.random(viewpoints) < 0.3)
    beacon[np.flatnonzero(utility)[0]] = True
    visited = rng.random(viewpoints) < 0.3
    visited[robot] = True
    offsets = (places - places[robot]).astype(np.int16)
    target_offset = np.zeros(2, dtype=np.float32)
    links = np.zeros(0, dtype=np.uint16)
    if target == "unknown":
        target_offset = rng.uniform(-30, 30, 2).astype(np.float32)
        links = np.flatnonzero(beacon)[:MAX_TARGET_LINKS].astype(np.uint16)
    elif target == "known":
        anchor = offsets[int(rng.integers(viewpoints))] / STEP_UNITS
        target_offset = (anchor + rng.uniform(-0.5, 0.5, 2)).astype(np.float32)
        distance = np.hypot(*(offsets / STEP_UNITS - target_offset).T)
        links = np.sort(np.argsort(distance, kind="stable")[: int(rng.integers(1, 13))]).astype(np.uint16)
    return Observation(
        offsets=offsets,
        utility=utility,
        visited=visited,
        beacon=beacon,
        degree=np.bincount(ends[:, 0], minlength=viewpoints).astype(np.uint8),
        neighbours=ends[:, 1].astype(np.uint16),
        bent=bent.astype(np.uint32),
        bent_length=(straight[bent] * rng.uniform(1.0, 2.0, len(bent)) + 0.1).astype(np.float32),
        robot=robot,
        has_target=target != "none",
        target_known=target == "known",
        target_offset=target_offset,
        target_links=links,
        cell=float(np.float32(rng.uniform(0.01, 0.25))),
        reach=float(np.float32(rng.uniform(2.0, 10.0))),
        route=_walk(rng, ends, robot).astype(np.uint16),
        image=rng.integers(0, 256, (len(IMAGES), IMAGE_SIDE**2)).astype(np.uint8) if image else None,
    )


def random_batch(
    rng: np.random.Generator,
    count: int,
    viewpoints: tuple[int, int] = (2, 40),
    targets: tuple[Target, ...] = TARGETS,
    *,
    lattice: bool = False,
    image: bool = False,
) -> ObservationBatch:
    """Stack ``count`` random observations with sizes drawn from the range ``viewpoints``, both ends included."""
    return ObservationBatch.stack(
        [
            random_observation(
                rng,
                int(rng.integers(viewpoints[0], viewpoints[1] + 1)),
                targets[rng.integers(len(targets))],
                lattice=lattice,
                image=image,
            )
            for _ in range(count)
        ]
    )


def observations(max_viewpoints: int = 40, *, image: bool = False) -> st.SearchStrategy[Observation]:
    """Strategy of random observations of all kinds, the smallest graphs included."""
    return st.builds(
        lambda seed, viewpoints, target, useful, share, lattice: random_observation(
            np.random.default_rng(seed), viewpoints, target, useful, share, lattice=lattice, image=image
        ),
        st.integers(0, 2**32 - 1),
        st.integers(2, max_viewpoints),
        st.sampled_from(TARGETS),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
        st.booleans(),
    )


def _walk(rng: np.random.Generator, ends: np.ndarray, robot: int) -> np.ndarray:
    """Return the nodes of a short walk along edges from the robot, which does not come back to it."""
    route: list[int] = []
    here = robot
    for _ in range(int(rng.integers(0, 12))):
        beside = np.concatenate([ends[ends[:, 0] == here, 1], ends[ends[:, 1] == here, 0]])
        beside = beside[beside != robot]
        if not len(beside):
            break
        here = int(rng.choice(beside))
        route.append(here)
    return np.array(route, dtype=np.int64)


def _grow(rng: np.random.Generator, count: int, lattice: bool) -> tuple[np.ndarray, np.ndarray]:
    """Grow a tree of viewpoints by random walks over squares.

    Returns:
        The square of each viewpoint, row-major, shape (count, 2), and the edges of the tree, shape (count - 1, 2).
    """
    squares = [(0, 0)]
    taken = {(0, 0)}
    tree = []
    while len(squares) < count:
        here = int(rng.integers(len(squares)))
        step = _BLOCK[int(rng.integers(len(_BLOCK)))]
        there = (squares[here][0] + int(step[0]), squares[here][1] + int(step[1]))
        if there not in taken or not (lattice or rng.random() < 0.8):
            tree.append((here, len(squares)))
            taken.add(there)
            squares.append(there)
    found = np.array(squares, dtype=np.int64)
    order = np.lexsort((found[:, 0], found[:, 1]))
    number = np.argsort(order)
    return found[order], np.sort(number[np.array(tree)], axis=1)
