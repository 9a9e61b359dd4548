"""Memory of the replay buffer: columns of viewpoints in a ring, and fixed-size columns of observations.

Pages behind the ring's tail go back to the operating system, so that the resident memory follows the content.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass, fields
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import ConfigError
from common.observation import MAX_TARGET_LINKS, MAX_VIEWPOINTS, NEIGHBOUR_COUNT

MAX_CHOICES = NEIGHBOUR_COUNT + 1
"""Waypoints of one observation at most: all neighbours and the target."""

_RELEASE_ROWS = 1 << 18

T = TypeVar("T", bound=np.generic)


class _Column(Generic[T]):
    """One lazily mapped array whose pages can be given back."""

    def __init__(self, rows: int, dtype: type[T], width: int = 1) -> None:
        kind = np.dtype(dtype)
        self._row_bytes = kind.itemsize * width
        self._map = mmap.mmap(-1, max(rows * self._row_bytes, mmap.PAGESIZE))
        flat: NDArray[T] = np.frombuffer(self._map, dtype=kind, count=rows * width)
        self.array: NDArray[T] = flat if width == 1 else flat.reshape(rows, width)

    def release(self, first: int, last: int) -> None:
        """Give back the whole pages within rows ``first`` to ``last``."""
        page = mmap.PAGESIZE
        begin = -(-first * self._row_bytes // page) * page
        end = last * self._row_bytes // page * page
        if end > begin and hasattr(mmap, "MADV_DONTNEED"):
            self._map.madvise(mmap.MADV_DONTNEED, begin, end - begin)


class ViewpointRing:
    """Ring of viewpoint rows; every piece is contiguous, and pieces leave in the order in which they came.

    With room for ``limit`` rows and two of the largest pieces, a piece always fits once the caller has evicted down
    to ``limit``: what is evicted then depends on the order of arrival alone, never on positions in memory.

    Attributes:
        offsets: int16, shape (rows, 2).
        utility: uint16.
        visited: bool.
        beacon: bool.
        edges: uint32.
        limit: rows held at most.
        live: rows held now.
    """

    ROW_BYTES = 12
    LARGEST_PIECE = MAX_VIEWPOINTS

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.live = 0
        self._rows = limit + 2 * self.LARGEST_PIECE
        self._head = 0
        self._tail = 0
        self._freed = (0, 0)
        offsets = _Column(self._rows, np.int16, 2)
        utility = _Column(self._rows, np.uint16)
        visited = _Column(self._rows, np.bool_)
        beacon = _Column(self._rows, np.bool_)
        edges = _Column(self._rows, np.uint32)
        self._columns = (offsets, utility, visited, beacon, edges)
        self.offsets, self.utility, self.edges = offsets.array, utility.array, edges.array
        self.visited, self.beacon = visited.array, beacon.array

    def place(self, rows: int) -> int:
        """Reserve ``rows`` contiguous rows and return the first; the caller has evicted down to the limit."""
        if rows > self.LARGEST_PIECE or self.live + rows > self.limit:
            raise ValueError(f"a piece of {rows} rows does not fit: {self.live} of {self.limit} rows are in use")
        if self._head + rows > self._rows:
            self._head = 0
        first = self._head
        self._head += rows
        self.live += rows
        return first

    def free(self, first: int, rows: int) -> None:
        """Take back the oldest rows that are in use."""
        self.live -= rows
        begin, end = self._freed
        if first != end or end - begin > _RELEASE_ROWS:
            for column in self._columns:
                column.release(begin, end)
            begin = first
        self._freed = (begin, first + rows)


@dataclass(slots=True, eq=False)
class SlotColumns:
    """What is kept of each observation beside its viewpoints; row = number of arrival modulo the number of slots.

    Attributes:
        start: first row in the viewpoint ring, int64.
        count: viewpoints, int32.
        robot: node number, int32.
        has_target: bool.
        target_known: bool.
        target_offset: float32, shape (slots, 2).
        link_count: int32.
        links: uint16, shape (slots, 20).
        choices: number of waypoints, int32.
        step: an action was chosen here, bool.
        beacon: chosen beacon, int32.
        waypoint: chosen waypoint, int32.
        reward: float32.
        version: policy version that chose, int64.
        successor: arrival number of the next observation, -1 where unknown, int64.
        predecessor: arrival number of the previous observation where it came in another chunk, else -1, int64.
        terminal: the successor ends the task, bool.
        labelled: an expert labelled this observation, bool.
        cost: the expert's cost of each waypoint, float32, shape (slots, 21).
        first_beacon: the expert's beacon, int32.
    """

    start: NDArray[np.int64]
    count: NDArray[np.int32]
    robot: NDArray[np.int32]
    has_target: NDArray[np.bool_]
    target_known: NDArray[np.bool_]
    target_offset: NDArray[np.float32]
    link_count: NDArray[np.int32]
    links: NDArray[np.uint16]
    choices: NDArray[np.int32]
    step: NDArray[np.bool_]
    beacon: NDArray[np.int32]
    waypoint: NDArray[np.int32]
    reward: NDArray[np.float32]
    version: NDArray[np.int64]
    successor: NDArray[np.int64]
    predecessor: NDArray[np.int64]
    terminal: NDArray[np.bool_]
    labelled: NDArray[np.bool_]
    cost: NDArray[np.float32]
    first_beacon: NDArray[np.int32]

    @classmethod
    def allocate(cls, slots: int) -> SlotColumns:
        """Return columns for ``slots`` observations; memory is taken when rows are first written."""

        def column(dtype: type[T], width: int = 1) -> NDArray[T]:
            return _Column(slots, dtype, width).array

        return cls(
            start=column(np.int64),
            count=column(np.int32),
            robot=column(np.int32),
            has_target=column(np.bool_),
            target_known=column(np.bool_),
            target_offset=column(np.float32, 2),
            link_count=column(np.int32),
            links=column(np.uint16, MAX_TARGET_LINKS),
            choices=column(np.int32),
            step=column(np.bool_),
            beacon=column(np.int32),
            waypoint=column(np.int32),
            reward=column(np.float32),
            version=column(np.int64),
            successor=column(np.int64),
            predecessor=column(np.int64),
            terminal=column(np.bool_),
            labelled=column(np.bool_),
            cost=column(np.float32, MAX_CHOICES),
            first_beacon=column(np.int32),
        )

    @classmethod
    def row_bytes(cls) -> int:
        """Bytes of one row over all columns."""
        row = cls.allocate(1)
        return sum(getattr(row, field.name).nbytes for field in fields(row))


def plan_memory(capacity: int, max_bytes: int) -> tuple[int, int]:
    """Split ``max_bytes`` into (observation slots, viewpoint rows).

    Every transition needs one slot, and every ended episode one more for its last observation: two per transition
    are the most that can be needed. They take an eighth of the memory at most.

    Raises:
        ConfigError: when the rest cannot hold one observation of the largest size.
    """
    slot_bytes = SlotColumns.row_bytes()
    slots = min(max(2 * capacity, 1024), max_bytes // 8 // slot_bytes)
    rows = (max_bytes - slots * slot_bytes) // ViewpointRing.ROW_BYTES - 2 * ViewpointRing.LARGEST_PIECE
    if rows < ViewpointRing.LARGEST_PIECE or slots < 2:
        raise ConfigError(
            f"replay.max_bytes is {max_bytes:,}, which cannot hold one observation of {MAX_VIEWPOINTS:,} viewpoints: "
            "set it to 1,000,000 or more"
        )
    return slots, rows
