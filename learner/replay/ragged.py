"""What of a chunk differs in size from observation to observation, laid out for the rings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import Chunk
from common.observations.index import waypoint_counts
from common.observations.observation import IMAGE_SIDE, IMAGES


@dataclass(frozen=True, slots=True, eq=False)
class RaggedParts:
    """What of a chunk of k observations goes into the rings.

    Attributes:
        arrays: the columns of each ring.
        choices: number of waypoints of each observation, int32, shape (k,).
        length: rows of each observation in each ring, int32, shape (k, rings).
        ends: first row of each observation in the arrays, then their number of rows, int64, shape (k + 1, rings).
    """

    arrays: tuple[tuple[NDArray[Any], ...], ...]
    choices: NDArray[np.int32]
    length: NDArray[np.int32]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, chunk: Chunk, *, hints: bool = False) -> RaggedParts:
        """Lay out a chunk, of a run whose labels have ``hints`` or have none."""
        batch, labels = chunk.observations, chunk.labels
        choices = waypoint_counts(batch)
        costs = np.zeros(len(batch), dtype=np.int32)
        if labels is not None:
            costs[: chunk.steps] = choices[: chunk.steps]
        counts = [batch.count, batch.edge_count, batch.bent_count, batch.link_count, batch.route_count, costs]
        pictures: tuple[tuple[NDArray[Any], ...], ...] = ()
        if batch.image is not None:
            counts.append(np.ones(len(batch), dtype=np.int32))
            pictures = ((batch.image.reshape(len(batch), -1),),)
        if hints:
            gains, truths = np.zeros(len(batch), dtype=np.int32), np.zeros(len(batch), dtype=np.int32)
            gain, truth = np.zeros(0, dtype=np.float32), np.zeros((0, len(IMAGES) * IMAGE_SIDE**2), dtype=np.uint8)
            if labels is not None and labels.gain is not None and labels.truth is not None:
                gains[: chunk.steps], truths[: chunk.steps] = batch.count[: chunk.steps], 1
                gain, truth = labels.gain, labels.truth.reshape(chunk.steps, -1)
            counts += [gains, truths]
            pictures = (*pictures, (gain,), (truth,))
        length = np.array(counts, dtype=np.int32).T
        ends = np.zeros((len(batch) + 1, len(counts)), dtype=np.int64)
        np.cumsum(length, axis=0, out=ends[1:])
        marks = batch.visited + 2 * batch.beacon.view(np.uint8)
        arrays = (
            (batch.offsets, batch.utility, marks, batch.degree),
            (batch.neighbours,),
            (batch.bent, batch.bent_length),
            (batch.target_links,),
            (batch.route,),
            (np.zeros(0, dtype=np.float32) if labels is None else labels.cost,),
            *pictures,
        )
        return cls(arrays, choices, length, ends)
