"""The guarantee of every generator: one connected lattice of viewpoints that together see all free space.

The lattice goes through the block centres, which are corners of cells. Lines of sight are those of the mapping, so
what is connected here is connected for the robot, whose belief has cells of the same size.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.connectivity import label_regions
from actors.maps.generators.base import Plan
from actors.maps.layout import BLOCK
from common.errors import MapError
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, FREE, OCCUPIED, blocker
from common.system.jit import njit

_HALF: Final = BLOCK // 2
# Half of the width of a passage that is carved to join two parts of the lattice: 10 px, 2.5 m at the nominal scale.
_CARVE: Final = 5
_ROUNDS: Final = 64
_TARGET_SHARE: Final = 0.5
# Lattice steps (dx, dy) to the 20 nearest points, row-major; number 19 - k is the reverse of number k.
_OFFSETS: Final = np.array(
    [(dx, dy) for dy in range(-2, 3) for dx in range(-2, 3) if 0 < dx * dx + dy * dy <= 5], dtype=np.int64
)


def finish(free: NDArray[np.bool_], rng: np.random.Generator) -> Plan:
    """Make a drawn place keep the generators' guarantee, and choose start and target.

    Only the largest region of free cells stays. Parts of the lattice that see nothing of the rest are joined by
    straight passages, then corners that no viewpoint sees are filled.

    Args:
        free: bool, shape (rows, columns), row 0 at the bottom; changed in place.
        rng: source of start and target.

    Returns:
        The plan. The target's way is at least half as many steps long as the longest from the start.

    Raises:
        MapError: no two viewpoints fit into the free space (the image is too small or too dense).
    """
    bottom = (free.shape[0] - _HALF) % BLOCK
    _keep_largest(free)
    dirty = np.ones((free.shape[0] // BLOCK + 1, free.shape[1] // BLOCK + 1), dtype=np.bool_)
    for _ in range(_ROUNDS):
        nodes = _nodes(free, bottom)
        if np.count_nonzero(nodes) < 2:
            raise MapError("a generated map has no room for two viewpoints: use a larger image or a lower density")
        cells = _padded(free)
        edges = _edges(cells, nodes, bottom, _OFFSETS)
        part = _largest_part(edges, nodes)
        if not np.array_equal(part, nodes):
            _join_nearest(free, part, nodes & ~part, bottom)
            dirty[:] = True
            continue
        # A cell that is seen is connected: a line of sight is a 4-connected chain of free cells.
        if _fill_unseen(free, cells, nodes, bottom, dirty):
            return _choose_ends(free, edges, nodes, rng, bottom)
    raise MapError("a generated map could not be connected: use another seed, and report this one")


def _cell(row: int, column: int, bottom: int) -> tuple[int, int]:
    """Return the (row, column) of the cell above and right of a lattice point."""
    return bottom + BLOCK * row, _HALF + BLOCK * column


def _keep_largest(free: NDArray[np.bool_]) -> None:
    labels, count = label_regions(free)
    if count > 1:
        free &= labels == int(np.bincount(labels.ravel())[1:].argmax()) + 1


def _padded(free: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return cells as the mapping's kernels take them, with an occupied ring, int8."""
    return np.pad(np.where(free, np.int8(FREE), np.int8(OCCUPIED)), 1, constant_values=OCCUPIED)


@njit(cache=True, nogil=True)
def _nodes(free: NDArray[np.bool_], bottom: int) -> NDArray[np.bool_]:
    """Return which lattice points are viewpoints, bool; fills the cells around points that touch an obstacle."""
    rows, columns = free.shape
    nodes = np.zeros(((rows - 1 - bottom) // BLOCK + 1, (columns - 1 - _HALF) // BLOCK + 1), dtype=np.bool_)
    for j in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            y, x = bottom + BLOCK * j, _HALF + BLOCK * i
            nodes[j, i] = y > 0 and free[y - 1, x - 1] and free[y - 1, x] and free[y, x - 1] and free[y, x]
            if not nodes[j, i]:
                free[max(y - 1, 0) : y + 1, x - 1 : x + 1] = False
    return nodes


@njit(cache=True, nogil=True)
def _clear(cells: NDArray[np.int8], x0: int, y0: int, x1: int, y1: int) -> bool:
    """Whether two points, in halves of a cell, see each other; the ring moves them by one cell."""
    half = SUBCELLS // 2
    return (
        blocker(
            cells.reshape(-1),
            cells.shape[1],
            (x0 + 2) * half,
            (y0 + 2) * half,
            (x1 + 2) * half,
            (y1 + 2) * half,
        )
        == CLEAR
    )


@njit(cache=True, nogil=True)
def _edges(
    cells: NDArray[np.int8], nodes: NDArray[np.bool_], bottom: int, offsets: NDArray[np.int64]
) -> NDArray[np.uint32]:
    """Return the 20-bit edge mask of each lattice point, uint32, shape of ``nodes``."""
    rows, columns = nodes.shape
    edges = np.zeros((rows, columns), dtype=np.uint32)
    last = len(offsets) - 1
    for j in range(rows):
        for i in range(columns):
            if not nodes[j, i]:
                continue
            for k in range(len(offsets) // 2):
                to_i, to_j = i + offsets[k, 0], j + offsets[k, 1]
                if not (0 <= to_i < columns and 0 <= to_j < rows) or not nodes[to_j, to_i]:
                    continue
                x, y = 2 * (_HALF + BLOCK * i), 2 * (bottom + BLOCK * j)
                if _clear(cells, x, y, x + 2 * BLOCK * offsets[k, 0], y + 2 * BLOCK * offsets[k, 1]):
                    edges[j, i] |= np.uint32(1) << np.uint32(k)
                    edges[to_j, to_i] |= np.uint32(1) << np.uint32(last - k)
    return edges


@njit(cache=True, nogil=True)
def _breadth_first(
    edges: NDArray[np.uint32], offsets: NDArray[np.int64], first_row: int, first_column: int
) -> NDArray[np.int32]:
    """Return the fewest edges from one lattice point to each, int32, -1 where no way leads."""
    rows, columns = edges.shape
    steps = np.full((rows, columns), -1, dtype=np.int32)
    queue = np.empty(rows * columns, dtype=np.int64)
    queue[0] = first_row * columns + first_column
    steps[first_row, first_column] = 0
    head, tail = 0, 1
    while head < tail:
        j, i = queue[head] // columns, queue[head] % columns
        head += 1
        for k in range(len(offsets)):
            if edges[j, i] >> np.uint32(k) & np.uint32(1):
                to_i, to_j = i + offsets[k, 0], j + offsets[k, 1]
                if steps[to_j, to_i] < 0:
                    steps[to_j, to_i] = steps[j, i] + 1
                    queue[tail] = to_j * columns + to_i
                    tail += 1
    return steps


def _largest_part(edges: NDArray[np.uint32], nodes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the viewpoints of the largest connected part of the graph, bool, shape of ``nodes``."""
    left = nodes.copy()
    largest = np.zeros_like(nodes)
    while np.count_nonzero(left) > np.count_nonzero(largest):
        row, column = divmod(int(np.argmax(left)), nodes.shape[1])
        part = _breadth_first(edges, _OFFSETS, row, column) >= 0
        left &= ~part
        if np.count_nonzero(part) > np.count_nonzero(largest):
            largest = part
    return largest


def _join_nearest(free: NDArray[np.bool_], part: NDArray[np.bool_], others: NDArray[np.bool_], bottom: int) -> None:
    """Carve a right-angled passage from the main part to the viewpoint of another part that is nearest to it."""
    inside, outside = np.argwhere(part), np.argwhere(others)
    steps = np.abs(outside[:, None, :] - inside[None, :, :]).sum(axis=2)
    nearest = int(steps.argmin())
    a, b = outside[nearest // len(inside)], inside[nearest % len(inside)]
    (ya, xa), (yb, xb) = (_cell(int(j), int(i), bottom) for j, i in (a, b))
    free[max(ya - _CARVE, 0) : ya + _CARVE, max(min(xa, xb) - _CARVE, 0) : max(xa, xb) + _CARVE] = True
    free[max(min(ya, yb) - _CARVE, 0) : max(ya, yb) + _CARVE, max(xb - _CARVE, 0) : xb + _CARVE] = True


@njit(cache=True, nogil=True)
def _seen_near(cells: NDArray[np.int8], nodes: NDArray[np.bool_], bottom: int, y: int, x: int) -> bool:
    """Whether a viewpoint at most two blocks away sees the centre of a cell; the nearest are asked first."""
    near_j = (y - bottom + BLOCK + _HALF) // BLOCK - 1
    near_i = x // BLOCK
    for ring in range(3):
        for j in range(max(near_j - ring, 0), min(near_j + ring + 1, nodes.shape[0])):
            # Inside the ring only its two sides are new.
            stride = 1 if abs(j - near_j) == ring else 2 * ring
            for i in range(near_i - ring, near_i + ring + 1, max(stride, 1)):
                if (
                    0 <= i < nodes.shape[1]
                    and nodes[j, i]
                    and _clear(cells, 2 * (_HALF + BLOCK * i), 2 * (bottom + BLOCK * j), 2 * x + 1, 2 * y + 1)
                ):
                    return True
    return False


@njit(cache=True, nogil=True)
def _fill_unseen(
    free: NDArray[np.bool_],
    cells: NDArray[np.int8],
    nodes: NDArray[np.bool_],
    bottom: int,
    dirty: NDArray[np.bool_],
) -> bool:
    """Fill the free cells that no viewpoint at most two blocks away sees; return whether there were none.

    Args:
        free: bool, changed in place.
        cells: the same, padded, as it was before.
        nodes: viewpoints.
        bottom: row of the lowest lattice points.
        dirty: squares of one block to look at, from the lower left corner; on return those near filled cells.
    """
    rows, columns = free.shape
    filled = np.zeros(dirty.shape, dtype=np.bool_)
    for square in range(dirty.size):
        j, i = square // dirty.shape[1], square % dirty.shape[1]
        if not dirty[j, i]:
            continue
        for y in range(j * BLOCK, min((j + 1) * BLOCK, rows), _HALF):
            for x in range(i * BLOCK, min((i + 1) * BLOCK, columns), _HALF):
                # Half a block without obstacles, with a viewpoint at its corner, is seen as a whole.
                near_j, near_i = (y - bottom + _HALF) // BLOCK, x // BLOCK
                whole = 0 <= near_j < nodes.shape[0] and 0 <= near_i < nodes.shape[1] and nodes[near_j, near_i]
                for row in range(y, min(y + _HALF, rows)):
                    for column in range(x, min(x + _HALF, columns)):
                        whole = whole and cells[row + 1, column + 1] == FREE
                if whole:
                    continue
                for row in range(y, min(y + _HALF, rows)):
                    for column in range(x, min(x + _HALF, columns)):
                        if free[row, column] and not _seen_near(cells, nodes, bottom, row, column):
                            free[row, column] = False
                            filled[j, i] = True
    dirty[:] = False
    for j in range(dirty.shape[0]):
        for i in range(dirty.shape[1]):
            if filled[j, i]:
                dirty[max(j - 3, 0) : j + 4, max(i - 3, 0) : i + 4] = True
    return not filled.any()


@njit(cache=True, nogil=True)
def _roomy(free: NDArray[np.bool_], nodes: NDArray[np.bool_], bottom: int) -> NDArray[np.bool_]:
    """Return the viewpoints with a free block around them, bool, shape of ``nodes``."""
    roomy = nodes.copy()
    for j in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            y, x = bottom + BLOCK * j, _HALF + BLOCK * i
            block = free[max(y - _HALF, 0) : y + _HALF, max(x - _HALF, 0) : x + _HALF]
            roomy[j, i] = nodes[j, i] and block.all()
    return roomy


def _choose_ends(
    free: NDArray[np.bool_], edges: NDArray[np.uint32], nodes: NDArray[np.bool_], rng: np.random.Generator, bottom: int
) -> Plan:
    """Choose a start with room for its marker, and a target far from it."""
    roomy = _roomy(free, nodes, bottom)
    candidates = np.argwhere(roomy if roomy.any() else nodes)
    start = candidates[int(rng.integers(len(candidates)))]
    steps = _breadth_first(edges, _OFFSETS, int(start[0]), int(start[1]))
    lengths = steps[candidates[:, 0], candidates[:, 1]]
    far = candidates[lengths >= max(1, _TARGET_SHARE * steps.max())]
    if not len(far):
        far = np.argwhere(steps == steps.max())
    target = far[int(rng.integers(len(far)))]
    (start_y, start_x), (target_y, target_x) = (_cell(int(j), int(i), bottom) for j, i in (start, target))
    return Plan(free=free, start=(start_x, start_y), target=(target_x, target_y))
