"""How much of the reachable clear area of the true map the robot has seen; for reward, termination and metrics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.maps.clear_space import clear_space
from actors.maps.connectivity import label_regions
from actors.maps.grid_map import GridMap
from common.system.jit import njit

UNKNOWN = -1


@njit(cache=True, nogil=True)
def _flood(free: NDArray[np.bool_], row: int, column: int) -> NDArray[np.int64]:
    """Return the flat numbers of all free cells that are 4-connected with (row, column), ascending."""
    rows, columns = free.shape
    seen = np.zeros(rows * columns, dtype=np.bool_)
    stack = np.empty(rows * columns, dtype=np.int64)
    size = 0
    if free[row, column]:
        stack[0] = row * columns + column
        seen[stack[0]] = True
        size = 1
    while size:
        size -= 1
        cell = stack[size]
        r = cell // columns
        c = cell - r * columns
        if r > 0 and free[r - 1, c] and not seen[cell - columns]:
            seen[cell - columns] = True
            stack[size] = cell - columns
            size += 1
        if r < rows - 1 and free[r + 1, c] and not seen[cell + columns]:
            seen[cell + columns] = True
            stack[size] = cell + columns
            size += 1
        if c > 0 and free[r, c - 1] and not seen[cell - 1]:
            seen[cell - 1] = True
            stack[size] = cell - 1
            size += 1
        if c < columns - 1 and free[r, c + 1] and not seen[cell + 1]:
            seen[cell + 1] = True
            stack[size] = cell + 1
            size += 1
    return np.flatnonzero(seen)


@njit(cache=True, nogil=True)
def _still_unseen(
    unseen: NDArray[np.int64],
    columns: int,
    belief: NDArray[np.int8],
    belief_row: NDArray[np.int64],
    belief_column: NDArray[np.int64],
) -> int:
    """Move the cells that the belief does not know to the front of ``unseen``, in order; return their number."""
    rows, width = belief.shape
    kept = 0
    row = 0
    first = 0
    for i in range(len(unseen)):
        cell = unseen[i]
        # Ascending cells: following the row along spares a division each.
        while cell >= first + columns:
            row += 1
            first += columns
        r = belief_row[row]
        c = belief_column[cell - first]
        if r < 0 or r >= rows or c < 0 or c >= width or belief[r, c] == UNKNOWN:
            unseen[kept] = cell
            kept += 1
    return kept


class Coverage:
    """The cells of one world that the robot could go to and has not seen.

    Reachable is what a flood fill from the start reaches over 4-connected clear cells (`clear_space`): for a robot
    without size all free cells that connect with the start. Behind an opening that a robot does not fit through there
    are free cells that it may never see, so they do not count; neither do the margins along walls. A cell counts as
    seen once the belief cell that holds its centre is known. What has been seen stays seen, so that a belief which
    corrects itself cannot undo an episode.
    """

    def __init__(self, world: GridMap, robot_radius: float = 0.0) -> None:
        """Begin with nothing seen.

        Args:
            world: the true map.
            robot_radius: metres, as in `MappingConfig`.

        Raises:
            MapError: the start is not in free space, or the robot does not fit there.
        """
        clear, start = clear_space(world, robot_radius)
        self._world = world
        self._unseen: NDArray[np.int64] = _flood(np.ascontiguousarray(clear), *start)
        self._reachable = len(self._unseen)
        self._frame: tuple[float, tuple[float, float]] | None = None
        rows, columns = world.free.shape
        self._belief_row = np.zeros(rows, dtype=np.int64)
        self._belief_column = np.zeros(columns, dtype=np.int64)

    def update(self, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float]) -> None:
        """Take over what a belief knows: -1 unknown, row 0 at the bottom, metres."""
        if self._frame != (resolution, origin):
            self._frame = (resolution, origin)
            world = self._world
            rows, columns = world.free.shape
            x = world.origin[0] + (np.arange(columns) + 0.5) * world.resolution
            y = world.origin[1] + (np.arange(rows) + 0.5) * world.resolution
            self._belief_column = np.floor((x - origin[0]) / resolution + 1e-9).astype(np.int64)
            self._belief_row = np.floor((y - origin[1]) / resolution + 1e-9).astype(np.int64)
        kept = _still_unseen(self._unseen, self._world.free.shape[1], cells, self._belief_row, self._belief_column)
        self._unseen = self._unseen[:kept]

    @property
    def unseen_cells(self) -> NDArray[np.int64]:
        """Flat cell numbers of the true map (row x columns + column) that are unseen, ascending."""
        return self._unseen

    @property
    def unseen_area(self) -> float:
        """Reachable clear area that is unseen, square metres."""
        return len(self._unseen) * self._world.resolution**2

    @property
    def explored(self) -> float:
        """Share of the reachable clear area that was seen, 0 to 1."""
        return 1.0 - len(self._unseen) / self._reachable

    def largest_unseen(self) -> tuple[float, tuple[float, float]] | None:
        """Return the largest connected region that is unseen: its area in square metres, and a place in it.

        Cells that share only a corner are connected too. The place is the centre of the region's cell that is nearest
        to its centroid, (x, y) in metres. None when nothing is unseen.
        """
        if not len(self._unseen):
            return None
        world = self._world
        rows, columns = np.divmod(self._unseen, world.free.shape[1])
        top, left = rows[0], columns.min()
        mask = np.zeros((rows[-1] - top + 1, columns.max() - left + 1), dtype=np.bool_)
        mask[rows - top, columns - left] = True
        labels, _ = label_regions(mask, diagonal=True)
        region = labels[rows - top, columns - left]
        sizes = np.bincount(region)
        largest = region == int(np.argmax(sizes))
        y, x = rows[largest] + 0.5, columns[largest] + 0.5
        middle = int(np.argmin((x - x.mean()) ** 2 + (y - y.mean()) ** 2))
        place = (
            world.origin[0] + float(x[middle]) * world.resolution,
            world.origin[1] + float(y[middle]) * world.resolution,
        )
        return int(sizes.max()) * world.resolution**2, place
