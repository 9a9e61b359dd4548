"""The explored volume as the CMU stack measures it: voxels of 0.5 m that hold a point, times 0.125 cubic metres."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit

VOXEL: Final = 0.5
# Voxels are numbered with 21 bits per axis, 524 km each way.
_BITS: Final = 21
_HALF: Final = 1 << (_BITS - 1)
_EMPTY: Final = -1
# Odd multiplier of Fibonacci hashing, 2^64 / golden ratio.
_MULTIPLIER: Final = 0x9E3779B97F4A7C15


@njit(cache=True, nogil=True)
def _insert(table: NDArray[np.int64], key: int) -> bool:
    """Put a key into an open-addressed table; True when it is new."""
    mask = len(table) - 1
    slot = np.int64((np.uint64(key) * np.uint64(_MULTIPLIER)) >> np.uint64(20)) & mask
    while table[slot] != _EMPTY:
        if table[slot] == key:
            return False
        slot = (slot + 1) & mask
    table[slot] = key
    return True


@njit(cache=True, nogil=True)
def _add(
    table: NDArray[np.int64],
    room: int,
    start: int,
    points: NDArray[np.float32],
    rotation: NDArray[np.float64],
    offset: NDArray[np.float64],
    origin: NDArray[np.float64],
    range_min: float,
    range_max: float,
) -> tuple[int, int]:
    """Add points from `start` on until `room` new voxels are there; return their number and the next point."""
    new = 0
    for n in range(start, len(points)):
        if new >= room:
            return new, n
        key = np.int64(0)
        far = 0.0
        for axis in range(3):
            value = offset[axis]
            for k in range(3):
                value += rotation[axis, k] * points[n, k]
            far += (value - origin[axis]) ** 2
            if not np.abs(value) < VOXEL * _HALF:
                far = np.inf
                break
            key = (key << _BITS) | (np.int64(np.floor(value / VOXEL)) + _HALF)
        if range_min**2 <= far <= range_max**2 and _insert(table, key):
            new += 1
    return new, len(points)


@njit(cache=True, nogil=True)
def _move(old: NDArray[np.int64], table: NDArray[np.int64]) -> None:
    for key in old:
        if key != _EMPTY:
            _insert(table, key)


class ExploredVolume:
    """The set of voxels in which points were seen; its memory grows with the explored space alone."""

    def __init__(self) -> None:
        self._table = np.full(1 << 12, _EMPTY, dtype=np.int64)
        self._count = 0

    @property
    def value(self) -> float:
        """Cubic metres."""
        return self._count * VOXEL**3

    def add(
        self,
        points: NDArray[np.float32],
        rotation: NDArray[np.float64],
        offset: NDArray[np.float64],
        origin: NDArray[np.float64],
        range_min: float,
        range_max: float,
    ) -> None:
        """Add a cloud; points with NaN, or nearer or farther than the limits from the sensor, are left out.

        Args:
            points: float32, shape (n, 3 or more), metres.
            rotation: of their frame in the map frame, shape (3, 3).
            offset: its translation, metres, shape (3,).
            origin: position of the sensor in the map frame, metres, shape (3,).
            range_min: metres.
            range_max: metres.
        """
        start = 0
        while start < len(points):
            # A table at most half full keeps the searches short.
            room = len(self._table) // 2 - self._count
            new, start = _add(self._table, room, start, points, rotation, offset, origin, range_min, range_max)
            self._count += new
            if start < len(points):
                table = np.full(2 * len(self._table), _EMPTY, dtype=np.int64)
                _move(self._table, table)
                self._table = table
