"""Grids in changed tiles: a belief of a building costs a few hundred bytes an update (format: docs/page.md)."""

from __future__ import annotations

import math
import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError

SIDE: Final = 64
"""Cells along a side of a tile; a run of equal cells has at most as many, so rows begin with a run of their own."""
GRID_FRAME: Final = 1
"""First byte of a binary frame that holds tiles of a grid."""
MAX_TILES: Final = 1 << 14
"""Tiles of a grid that are sent at most: 1.6 km square at 0.2 m."""
_MOST_LEFT: Final = 64
_OCCUPIED_FROM: Final = 50
_HEAD: Final = struct.Struct("<BB")
_BODY: Final = struct.Struct("<BdddH")
_TILE: Final = struct.Struct("<hhH")


class TileGrid:
    """The newest grid, in tiles that keep their place while it grows, and the revision in which each changed last.

    A tile is known by (row, column) from the anchor, the lower left corner of the first grid. Cells are 0 unknown,
    1 free, 2 occupied. Tiles in which nothing is known are not kept, so a grid that moves with its robot does not grow.

    Attributes:
        revision: of the newest change, 0 before the first grid.
    """

    def __init__(self, name: str) -> None:
        """Make an empty grid of a channel of this name."""
        self.revision = 0
        self._name = name
        self._tiles: dict[tuple[int, int], tuple[int, NDArray[np.uint8], bytes]] = {}
        # Tiles that became unknown, and the revision in which they did: browsers that have them are to forget them.
        self._left: dict[tuple[int, int], int] = {}
        self._anchor = (0.0, 0.0)
        self._resolution = 0.0
        self._whole_since = 0

    def update(self, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float]) -> bool:
        """Take in a grid and return whether anything changed.

        Args:
            cells: as a ROS OccupancyGrid has them (-1, 0 to 100), shape (rows, columns).
            resolution: metres.
            origin: lower left corner of the first cell, metres.

        Raises:
            MessageError: it is larger than `MAX_TILES`, or lies out of reach of its anchor.
        """
        column, row = self._place(resolution, origin)
        rows, columns = cells.shape
        first_row, first_column = row // SIDE, column // SIDE
        last_row, last_column = (row + rows - 1) // SIDE, (column + columns - 1) // SIDE
        count = (last_row - first_row + 1) * (last_column - first_column + 1)
        if count > MAX_TILES or max(map(abs, (first_row, first_column, last_row, last_column))) > 32767:
            raise MessageError(self._name, f"must have at most {MAX_TILES} tiles of {SIDE} x {SIDE} cells, got {count}")
        padded = np.zeros(((last_row - first_row + 1) * SIDE, (last_column - first_column + 1) * SIDE), np.uint8)
        below, left = row - first_row * SIDE, column - first_column * SIDE
        padded[below : below + rows, left : left + columns] = _states(cells)
        changed = False
        seen = set()
        for tile_row in range(first_row, last_row + 1):
            at = (tile_row - first_row) * SIDE
            strip = padded[at : at + SIDE]
            for tile_column in range(first_column, last_column + 1):
                across = (tile_column - first_column) * SIDE
                seen.add((tile_row, tile_column))
                changed |= self._put((tile_row, tile_column), strip[:, across : across + SIDE])
        for gone in self._tiles.keys() - seen:
            changed |= self._put(gone, _UNKNOWN)
        if changed:
            self.revision += 1
            self._forget_left()
        return changed

    def since(self, cursor: int) -> bytes:
        """Return the frame with the tiles that changed after a revision; all of them for one that is too old."""
        whole = cursor <= self._whole_since
        changed = [(place, data) for place, (revision, _, data) in self._tiles.items() if whole or revision > cursor]
        if not whole:
            changed += [(place, _UNKNOWN_DATA) for place, revision in self._left.items() if revision > cursor]
        parts = [part for place, data in changed for part in (_TILE.pack(*place, len(data)), data)]
        name = self._name.encode()
        head = _HEAD.pack(GRID_FRAME, len(name)) + name
        return b"".join([head, _BODY.pack(whole, *self._anchor, self._resolution, len(changed)), *parts])

    def _place(self, resolution: float, origin: tuple[float, float]) -> tuple[int, int]:
        """Return the column and row of a grid's first cell from the anchor; begin anew where it is another grid."""
        if self.revision and math.isclose(resolution, self._resolution, rel_tol=1e-9):
            steps = [(at - before) / resolution for at, before in zip(origin, self._anchor, strict=True)]
            column, row = round(steps[0]), round(steps[1])
            if max(abs(steps[0] - column), abs(steps[1] - row)) < 0.01 and max(abs(column), abs(row)) < SIDE << 15:
                return column, row
        self._tiles.clear()
        self._left.clear()
        self._anchor, self._resolution = (float(origin[0]), float(origin[1])), float(resolution)
        self._whole_since = self.revision
        return 0, 0

    def _put(self, place: tuple[int, int], cells: NDArray[np.uint8]) -> bool:
        before = self._tiles.get(place)
        if not cells.any():
            if before is not None:
                del self._tiles[place]
                self._left[place] = self.revision + 1
            return before is not None
        if before is not None and np.array_equal(before[1], cells):
            return False
        self._tiles[place] = (self.revision + 1, cells.copy(), encode_tile(cells))
        self._left.pop(place, None)
        return True

    def _forget_left(self) -> None:
        """Forget which tiles were left where they outnumber the others: who still has them gets all tiles anew."""
        if len(self._left) > len(self._tiles) + _MOST_LEFT:
            self._whole_since = max(self._left.values()) - 1
            self._left.clear()


def encode_tile(cells: NDArray[np.uint8]) -> bytes:
    """Encode the states of a tile, shape (64, 64), as runs: two bits of state, six of the length less one."""
    flat = cells.ravel()
    begins = np.ones(flat.size, bool)
    np.not_equal(flat[1:], flat[:-1], out=begins[1:])
    begins[::SIDE] = True
    at = np.flatnonzero(begins)
    lengths = np.diff(at, append=flat.size)
    return (flat[at] << 6 | (lengths - 1).astype(np.uint8)).tobytes()


_UNKNOWN: Final = np.zeros((SIDE, SIDE), np.uint8)
_UNKNOWN_DATA: Final = encode_tile(_UNKNOWN)


def _states(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """Return 0 unknown, 1 free, 2 occupied."""
    return np.where(cells < 0, 0, np.where(cells >= _OCCUPIED_FROM, 2, 1)).astype(np.uint8)
