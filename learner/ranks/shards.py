"""The parts of a batch that the ranks compute."""

from __future__ import annotations

import itertools

import numpy as np

from learner.algorithm.batch import TransitionBatch


def split(batch: TransitionBatch, size: int) -> list[TransitionBatch]:
    """Return ``size`` consecutive parts of a batch with about the same work each, and at least one row.

    Args:
        batch: of at least ``size`` transitions.
        size: number of ranks.
    """
    # Time goes with nodes and edges: attention runs along edges, all else along nodes.
    work = np.cumsum(batch.observations.count + batch.observations.edge_count)
    cuts = np.searchsorted(work, work[-1] * np.arange(1, size) / size, side="left") + 1
    # Each part keeps a row, whatever the sizes of the observations are.
    number = np.arange(1, size)
    cuts = np.clip(np.maximum.accumulate(cuts - number) + number, number, len(batch) - size + number)
    bounds = np.concatenate([[0], cuts, [len(batch)]])
    row = np.arange(len(batch))
    return [batch.select((row >= first) & (row < end)) for first, end in itertools.pairwise(bounds)]
