"""Memory of the replay buffer: rings for what differs in size from observation to observation, columns for the rest.

Pages behind a ring's tail go back to the operating system, so that the resident memory follows the content.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import ConfigError
from common.messages.experience_codec import MAX_STEPS
from common.observations.observation import (
    IMAGE_SIDE,
    IMAGES,
    MAX_DEGREE,
    MAX_EDGES,
    MAX_ROUTE,
    MAX_TARGET_LINKS,
    MAX_VIEWPOINTS,
)

# Freed rows are given back to the operating system when they are this many bytes.
_RELEASE_BYTES = 1 << 21

T = TypeVar("T", bound=np.generic)


class _Column(Generic[T]):
    """One lazily mapped array whose pages can be given back."""

    def __init__(self, rows: int, dtype: type[T], width: int = 1) -> None:
        kind = np.dtype(dtype)
        self.row_bytes = kind.itemsize * width
        # Private: pages of a shared mapping would stay in memory after they are given back.
        size = max(rows * self.row_bytes, mmap.PAGESIZE)
        try:
            self._map = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE)
        except (OSError, OverflowError) as error:
            raise ConfigError(
                f"this machine has no {size:,} bytes of memory for a part of the replay buffer: lower replay.max_bytes"
            ) from error
        flat: NDArray[T] = np.frombuffer(self._map, dtype=kind, count=rows * width)
        self.array: NDArray[T] = flat if width == 1 else flat.reshape(rows, width)

    def release(self, first: int, last: int) -> None:
        """Give back the whole pages within rows ``first`` to ``last``."""
        page = mmap.PAGESIZE
        begin = -(-first * self.row_bytes // page) * page
        end = last * self.row_bytes // page * page
        if end > begin and hasattr(mmap, "MADV_DONTNEED"):
            self._map.madvise(mmap.MADV_DONTNEED, begin, end - begin)


@dataclass(frozen=True, slots=True)
class RingKind:
    """What a ring holds.

    Attributes:
        columns: dtype and width of each column.
        largest: rows of one piece at most: the largest observation fits, and so does a chunk of ordinary ones.
    """

    columns: tuple[tuple[type[np.generic], int], ...]
    largest: int

    @property
    def row_bytes(self) -> int:
        """Bytes of one row over all columns."""
        return sum(np.dtype(dtype).itemsize * width for dtype, width in self.columns)


VIEWPOINTS, EDGES, BENT, LINKS, ROUTES, COSTS, PICTURES, GAINS, TRUTHS = range(9)
"""Numbers of the rings; the last three are there only in buffers whose observations have images, and the last two of
these only in those whose labels have hints."""
KINDS = (
    # Offsets, utility, visited + 2 beacon, degree.
    RingKind(((np.int16, 2), (np.uint16, 1), (np.uint8, 1), (np.uint8, 1)), MAX_VIEWPOINTS),
    # Neighbours.
    RingKind(((np.uint16, 1),), MAX_EDGES),
    # Bent edges and their lengths.
    RingKind(((np.uint32, 1), (np.float32, 1)), MAX_EDGES),
    # Target links.
    RingKind(((np.uint16, 1),), MAX_TARGET_LINKS * (MAX_STEPS + 1)),
    # Reference routes.
    RingKind(((np.uint16, 1),), MAX_ROUTE * (MAX_STEPS + 1)),
    # The expert's cost of each waypoint: all neighbours and the target.
    RingKind(((np.float32, 1),), (MAX_DEGREE + 1) * (MAX_STEPS + 1)),
)
# Images of one observation. Chunks of more observations are stored one by one.
_PICTURES = RingKind(((np.uint8, len(IMAGES) * IMAGE_SIDE**2),), 32)


# What each viewpoint would show.
_GAINS = RingKind(((np.float32, 1),), MAX_VIEWPOINTS)


def ring_kinds(images: bool, hints: bool) -> tuple[RingKind, ...]:
    """Return what the rings of a buffer hold, whose observations have images or not, and whose labels have hints."""
    pictured = (*KINDS, _PICTURES) if images else KINDS
    return (*pictured, _GAINS, _PICTURES) if hints else pictured


def largest_piece(kinds: Sequence[RingKind]) -> int:
    """Bytes in all rings that one piece takes at most."""
    return sum(kind.largest * kind.row_bytes for kind in kinds)


class Ring:
    """Ring of rows; every piece is contiguous, and pieces leave in the order in which they came.

    With room for what ``max_bytes`` can hold and two of the largest pieces, a piece always fits once the caller has
    evicted down to ``max_bytes``: what is evicted then depends on the order of arrival alone, never on positions in
    memory.

    Args:
        kind: of the rows.
        max_bytes: bytes of live rows at most.

    Attributes:
        arrays: the columns.
        live: rows held now.
        row_bytes: bytes of one row over all columns.
        largest: rows of one piece at most.
    """

    def __init__(self, kind: RingKind, max_bytes: int) -> None:
        self.live = 0
        self.largest = kind.largest
        self.row_bytes = kind.row_bytes
        self._limit = max_bytes // kind.row_bytes
        self._rows = self._limit + 2 * kind.largest
        self._head = 0
        self._freed = (0, 0)
        self._columns = [_Column(self._rows, dtype, width) for dtype, width in kind.columns]
        self.arrays: tuple[NDArray[Any], ...] = tuple(column.array for column in self._columns)

    def append(self, sources: Sequence[NDArray[Any]], begin: int, end: int) -> int:
        """Store rows ``begin`` to ``end - 1`` of ``sources`` as one piece and return its first row in the ring.

        Args:
            sources: an array for each column.
            begin: first row there.
            end: row behind the last; the caller has evicted down to the limit.
        """
        rows = end - begin
        if rows > self.largest or self.live + rows > self._limit:
            raise ValueError(f"a piece of {rows} rows does not fit: {self.live} of {self._limit} rows are in use")
        if self._head + rows > self._rows:
            self._head = 0
        first = self._head
        for array, source in zip(self.arrays, sources, strict=True):
            array[first : first + rows] = source[begin:end]
        self._head += rows
        self.live += rows
        return first

    def free(self, first: int, rows: int) -> None:
        """Take back the oldest rows that are in use, one or more."""
        self.live -= rows
        begin, end = self._freed
        if first != end or (end - begin) * self.row_bytes > _RELEASE_BYTES:
            for column in self._columns:
                column.release(begin, end)
            begin = first
        self._freed = (begin, first + rows)


@dataclass(slots=True, eq=False)
class SlotColumns:
    """What is kept of each observation beside its rows in the rings; row = number of arrival modulo number of slots.

    Attributes:
        delivery: number of the delivery that it came with, counted by the buffer, int64.
        first: first row in each ring, int64, shape (slots, rings).
        length: rows in each ring, int32, shape (slots, rings).
        robot: node number, int32.
        has_target: bool.
        target_known: bool.
        target_offset: float32, shape (slots, 2).
        cell: float32.
        reach: float32.
        choices: number of waypoints, int32.
        step: an action was chosen here, bool.
        beacon: chosen beacon, int32.
        waypoint: chosen waypoint, int32.
        reward: float32.
        version: policy version that chose, int64.
        probability: of the chosen waypoint under that policy, 0 where no policy drew, float32.
        family: number of the family of worlds, uint8.
        successor: arrival number of the next observation, -1 where unknown, int64.
        predecessor: arrival number of the previous observation where it came in another chunk, else -1, int64.
        terminal: the successor ends the task, bool.
        labelled: an expert labelled this observation, bool.
        first_beacon: the expert's beacon, int32.
        remaining: the expert's remaining distance, metres, float32.
        unseen: reachable area not seen yet, square metres, float32.
    """

    delivery: NDArray[np.int64]
    first: NDArray[np.int64]
    length: NDArray[np.int32]
    robot: NDArray[np.int32]
    has_target: NDArray[np.bool_]
    target_known: NDArray[np.bool_]
    target_offset: NDArray[np.float32]
    cell: NDArray[np.float32]
    reach: NDArray[np.float32]
    choices: NDArray[np.int32]
    step: NDArray[np.bool_]
    beacon: NDArray[np.int32]
    waypoint: NDArray[np.int32]
    reward: NDArray[np.float32]
    version: NDArray[np.int64]
    probability: NDArray[np.float32]
    family: NDArray[np.uint8]
    successor: NDArray[np.int64]
    predecessor: NDArray[np.int64]
    terminal: NDArray[np.bool_]
    labelled: NDArray[np.bool_]
    first_beacon: NDArray[np.int32]
    remaining: NDArray[np.float32]
    unseen: NDArray[np.float32]

    @classmethod
    def allocate(cls, slots: int, rings: int) -> SlotColumns:
        """Return columns for ``slots`` observations; memory is taken when rows are first written."""

        def column(dtype: type[T], width: int = 1) -> NDArray[T]:
            return _Column(slots, dtype, width).array

        return cls(
            delivery=column(np.int64),
            first=column(np.int64, rings),
            length=column(np.int32, rings),
            robot=column(np.int32),
            has_target=column(np.bool_),
            target_known=column(np.bool_),
            target_offset=column(np.float32, 2),
            cell=column(np.float32),
            reach=column(np.float32),
            choices=column(np.int32),
            step=column(np.bool_),
            beacon=column(np.int32),
            waypoint=column(np.int32),
            reward=column(np.float32),
            version=column(np.int64),
            probability=column(np.float32),
            family=column(np.uint8),
            successor=column(np.int64),
            predecessor=column(np.int64),
            terminal=column(np.bool_),
            labelled=column(np.bool_),
            first_beacon=column(np.int32),
            remaining=column(np.float32),
            unseen=column(np.float32),
        )

    @classmethod
    def row_bytes(cls, rings: int) -> int:
        """Bytes of one row over all columns."""
        row = cls.allocate(1, rings)
        return sum(getattr(row, field.name).nbytes for field in fields(row))


def plan_memory(capacity: int, max_bytes: int, kinds: Sequence[RingKind]) -> tuple[int, int]:
    """Split ``max_bytes`` into (observation slots, bytes of all rings together).

    Every transition needs one slot, and every ended episode one more for its last observation: two per transition
    are the most that can be needed. They take an eighth of the memory at most.

    Raises:
        ConfigError: when the rest cannot hold one observation of the largest size.
    """
    slot_bytes = SlotColumns.row_bytes(len(kinds))
    slots = min(max(2 * capacity, 1024), max_bytes // 8 // slot_bytes)
    ring_bytes = max_bytes - slots * slot_bytes
    if ring_bytes < largest_piece(kinds) or slots < 2:
        raise ConfigError(
            f"replay.max_bytes is {max_bytes:,}, which cannot hold one observation of {MAX_VIEWPOINTS:,} viewpoints "
            f"with {MAX_DEGREE} neighbours each: set it to 30,000,000 or more"
        )
    return slots, ring_bytes
