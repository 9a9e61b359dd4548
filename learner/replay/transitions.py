"""Steps that were drawn from the replay buffer as the batch of an update."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from learner.algorithm.batch import TransitionBatch
from learner.replay.store import ObservationStore


def make_batch(
    store: ObservationStore, rows: NDArray[np.int64], oldest: int, steps: int, gamma: float, *, judged: bool
) -> TransitionBatch:
    """Put together the batch of some steps, with the sums of their next rewards.

    Args:
        store: where the steps are.
        rows: of the steps.
        oldest: arrival number of the oldest observation there.
        steps: rewards that are summed; fewer where the episode ends or its next step is not there.
        gamma: discount factor.
        judged: with the labels of the observations that follow.
    """
    columns = store.columns
    successor = columns.successor[rows]
    valid = successor >= 0
    following = np.where(valid, successor % store.slots, rows)
    rewards, terminal = columns.reward[rows], columns.terminal[rows]
    discounts = np.full(len(rows), gamma, dtype=np.float32)
    for _ in range(steps - 1):
        # Steps alone have a successor, and the row that follows a terminal step is no step.
        onward = valid & (columns.successor[following] >= 0)
        rewards[onward] += discounts[onward] * columns.reward[following[onward]]
        terminal[onward] = columns.terminal[following[onward]]
        discounts[onward] *= gamma
        following[onward] = columns.successor[following[onward]] % store.slots
    labelled = columns.labelled[rows]
    next_labelled = columns.labelled[following] & valid
    return TransitionBatch(
        observations=store.observations(rows),
        next_observations=store.observations(following),
        beacons=columns.beacon[rows],
        waypoints=columns.waypoint[rows],
        rewards=rewards,
        discounts=discounts,
        terminal=terminal,
        next_valid=valid,
        probabilities=columns.probability[rows],
        families=columns.family[rows],
        labelled=labelled,
        labels=store.labels(rows, labelled) if labelled.any() else None,
        next_labelled=next_labelled,
        next_labels=store.labels(following, next_labelled) if judged else None,
        arrivals=oldest + (rows - oldest) % store.slots,
    )
