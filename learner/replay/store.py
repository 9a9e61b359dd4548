"""The observations of the replay buffer in memory: written piece by piece, read back as a batch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import ExpertLabels
from common.observations.observation import IMAGE_SIDE, IMAGES, ObservationBatch
from learner.replay.gather import gather
from learner.replay.memory import (
    BENT,
    COSTS,
    EDGES,
    GAINS,
    LINKS,
    PICTURES,
    ROUTES,
    TRUTHS,
    VIEWPOINTS,
    Ring,
    SlotColumns,
    plan_memory,
    ring_kinds,
)
from learner.replay.ragged import RaggedParts


class ObservationStore:
    """Rows of observations: their ragged parts lie in rings, everything else in columns.

    Row = arrival number of the observation modulo the number of slots. The caller frees the oldest rows before it
    writes beyond the limits.

    Args:
        capacity: transitions that are to fit.
        max_bytes: memory held at most.
        images: the observations have images; otherwise none has.
        hints: so do the labels have hints, of observations with images.

    Attributes:
        slots: number of rows.
        columns: what is kept of each row beside the rings; those of the actions are the caller's.
        ring_bytes: bytes of live rows in all rings together at most.
        live_bytes: bytes of live rows in all rings together.
        hints: the labels have hints.
    """

    def __init__(self, capacity: int, max_bytes: int, *, images: bool = False, hints: bool = False) -> None:
        kinds = ring_kinds(images, hints)
        self.slots, self.ring_bytes = plan_memory(capacity, max_bytes, kinds)
        self.columns = SlotColumns.allocate(self.slots, len(kinds))
        self.slot_bytes = SlotColumns.row_bytes(len(kinds))
        self.live_bytes = 0
        self._images = images
        self.hints = hints
        self._row_bytes = np.array([kind.row_bytes for kind in kinds])
        self._rings = [Ring(kind, self.ring_bytes) for kind in kinds]

    def takes_whole(self, ragged: RaggedParts) -> bool:
        """Whether all observations of a chunk go in as one piece."""
        return bool((ragged.ends[-1] <= [ring.largest for ring in self._rings]).all())

    def size(self, ragged: RaggedParts, low: int, high: int) -> int:
        """Bytes that observations ``low`` to ``high - 1`` take in the rings."""
        return int((ragged.ends[high] - ragged.ends[low]) @ self._row_bytes)

    def write(self, batch: ObservationBatch, ragged: RaggedParts, low: int, high: int, first: int) -> NDArray[np.int64]:
        """Write observations ``low`` to ``high - 1``, contiguous in every ring; return their rows.

        Args:
            batch: the observations of a chunk.
            ragged: of the same chunk.
            low: first of the piece.
            high: behind the last of the piece.
            first: arrival number of observation ``low``.
        """
        columns = self.columns
        begin, end = ragged.ends[low], ragged.ends[high]
        self.live_bytes += self.size(ragged, low, high)
        places = [
            ring.append(arrays, first_row, last_row)
            for ring, arrays, first_row, last_row in zip(
                self._rings, ragged.arrays, begin.tolist(), end.tolist(), strict=True
            )
        ]
        rows = np.arange(first, first + high - low) % self.slots
        part = slice(low, high)
        columns.first[rows] = ragged.ends[part] - begin + places
        columns.length[rows] = ragged.length[part]
        columns.robot[rows] = batch.robot[part]
        columns.has_target[rows] = batch.has_target[part]
        columns.target_known[rows] = batch.target_known[part]
        columns.target_offset[rows] = batch.target_offset[part]
        columns.cell[rows] = batch.cell[part]
        columns.reach[rows] = batch.reach[part]
        columns.choices[rows] = ragged.choices[part]
        return rows

    def free(self, row: int) -> None:
        """Take back what the oldest row has in the rings."""
        first, length = self.columns.first[row].tolist(), self.columns.length[row].tolist()
        for ring, begin, rows in zip(self._rings, first, length, strict=True):
            if rows:
                self.live_bytes -= rows * ring.row_bytes
                ring.free(begin, rows)

    def observations(self, rows: NDArray[np.int64]) -> ObservationBatch:
        """Return the observations of some rows."""
        columns = self.columns
        length = np.ascontiguousarray(columns.length[rows].T)
        offsets, utility, marks, degree = self._pieces(VIEWPOINTS, rows)
        (neighbours,) = self._pieces(EDGES, rows)
        bent, bent_length = self._pieces(BENT, rows)
        (target_links,) = self._pieces(LINKS, rows)
        (route,) = self._pieces(ROUTES, rows)
        return ObservationBatch(
            count=length[VIEWPOINTS],
            offsets=offsets,
            utility=utility,
            visited=(marks & 1) != 0,
            beacon=(marks & 2) != 0,
            degree=degree,
            edge_count=length[EDGES],
            neighbours=neighbours,
            bent_count=length[BENT],
            bent=bent,
            bent_length=bent_length,
            robot=columns.robot[rows],
            has_target=columns.has_target[rows],
            target_known=columns.target_known[rows],
            target_offset=columns.target_offset[rows],
            link_count=length[LINKS],
            target_links=target_links,
            cell=columns.cell[rows],
            reach=columns.reach[rows],
            route_count=length[ROUTES],
            route=route,
            image=self._pieces(PICTURES, rows)[0].reshape(len(rows), len(IMAGES), -1) if self._images else None,
        )

    def labels(self, rows: NDArray[np.int64], labelled: NDArray[np.bool_]) -> ExpertLabels:
        """Return the expert's labels of some rows; those of rows that are not ``labelled`` mean nothing."""
        columns = self.columns
        choices = columns.choices[rows]
        cost = np.zeros(int(choices.sum()), dtype=np.float32)
        cost[np.repeat(labelled, choices)] = self._pieces(COSTS, rows[labelled])[0]
        gain: NDArray[np.float32] | None = None
        truth: NDArray[np.uint8] | None = None
        if self.hints:
            counts = columns.length[rows, VIEWPOINTS]
            gain = np.full(int(counts.sum()), -1.0, dtype=np.float32)
            gain[np.repeat(labelled, counts)] = self._pieces(GAINS, rows[labelled])[0]
            truth = np.zeros((len(rows), len(IMAGES), IMAGE_SIDE**2), dtype=np.uint8)
            truth[labelled] = self._pieces(TRUTHS, rows[labelled])[0].reshape(-1, *truth.shape[1:])
        return ExpertLabels(
            cost=cost,
            beacon=np.where(labelled, columns.first_beacon[rows], -1).astype(np.int32),
            remaining=np.where(labelled, columns.remaining[rows], np.float32(0.0)),
            unseen=np.where(labelled, columns.unseen[rows], np.float32(0.0)),
            gain=gain,
            truth=truth,
        )

    def _pieces(self, ring: int, rows: NDArray[np.int64]) -> list[NDArray[Any]]:
        """Return the columns of a ring for some observations, one behind the other."""
        first, length = self.columns.first[rows, ring], self.columns.length[rows, ring]
        return [gather(array, first, length) for array in self._rings[ring].arrays]
