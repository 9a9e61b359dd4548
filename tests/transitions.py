"""Random valid transition batches for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from common.messages.experience import ExpertLabels
from common.observations.observation import ObservationBatch
from learner.algorithm.batch import TransitionBatch
from tests.observations import TARGETS, Target, random_batch


def random_transitions(
    rng: np.random.Generator,
    count: int,
    viewpoints: tuple[int, int] = (2, 30),
    targets: tuple[Target, ...] = TARGETS,
    labelled: float = 0.0,
    *,
    image: bool = False,
) -> TransitionBatch:
    """Draw ``count`` transitions with valid choices; ``labelled`` is the share that an expert has labelled."""
    now = random_batch(rng, count, viewpoints, targets, image=image)
    after = random_batch(rng, count, viewpoints, targets, image=image)
    terminal = rng.random(count) < 0.1
    marks = rng.random(count) < labelled
    next_marks = rng.random(count) < labelled
    return TransitionBatch(
        observations=now,
        next_observations=after,
        beacons=np.array([rng.choice(now[k].beacon_nodes()) for k in range(count)], dtype=np.int32),
        waypoints=np.array([rng.choice(now[k].waypoint_nodes()) for k in range(count)], dtype=np.int32),
        rewards=rng.normal(size=count).astype(np.float32),
        discounts=np.full(count, 0.99, dtype=np.float32),
        terminal=terminal,
        probabilities=rng.uniform(0.05, 1.0, count).astype(np.float32),
        families=rng.integers(3, size=count).astype(np.uint8),
        next_valid=terminal | (rng.random(count) < 0.95),
        labelled=marks,
        labels=_labels(rng, now, marks) if marks.any() else None,
        next_labelled=next_marks,
        next_labels=_labels(rng, after, next_marks) if next_marks.any() else None,
    )


def _labels(rng: np.random.Generator, now: ObservationBatch, marks: np.ndarray) -> ExpertLabels:
    costs, beacons = [], []
    for k in range(len(now)):
        cost = rng.uniform(0.0, 40.0, len(now[k].waypoint_nodes())).astype(np.float32)
        cost[rng.integers(len(cost))] = 0.0
        costs.append(cost if marks[k] else np.zeros_like(cost))
        beacons.append(rng.choice(now[k].beacon_nodes()) if marks[k] else -1)
    remaining, unseen = rng.uniform(1.0, 300.0, len(now)), rng.uniform(0.0, 2000.0, len(now))
    return ExpertLabels(
        cost=np.concatenate(costs),
        beacon=np.array(beacons, dtype=np.int32),
        remaining=np.where(marks, remaining, 0.0).astype(np.float32),
        unseen=np.where(marks, unseen, 0.0).astype(np.float32),
    )
