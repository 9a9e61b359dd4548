"""Where the robot might fit: the optimistic world with the robot's radius around all obstacles."""

from __future__ import annotations

from math import ceil, hypot

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.mapping.belief import Belief
from common.mapping.clearance import CLEAR_CELL, TIGHT, Clearance
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, Box, blocker
from common.mapping.standing import MARGIN_REACH
from common.planners.base import Position
from common.planners.navigation.cell_path import cell_path, connected
from common.planners.navigation.optimistic import MARGIN, OptimisticBelief
from common.planners.viewpoint_planner import TOLERANCE


class PossibleSpace:
    """Clear space of the world at its best.

    Attributes:
        world: the cells underneath.
        clear: CLEAR_CELL, TIGHT or anything else where the robot does not fit, int8, shape of the padded grid.
        resized: whether the last update moved the grid, so that cells and subcells of before are void.
    """

    def __init__(self, config: MappingConfig) -> None:
        """Cover nothing yet."""
        self._radius = config.robot_radius
        self._reach = ceil((config.robot_radius + MARGIN_REACH) / config.resolution)
        self.world = OptimisticBelief(MARGIN * config.viewpoint_spacing)
        self.resized = False

    def update(self, belief: Belief, *places: Position) -> Box | None:
        """Take over what the belief says now, on a grid that holds all of its cells and the places, metres.

        Returns:
            Box that holds all cells of another clearance (first row, last row, first column, last column of the padded
            grid), all of it after a resize; None when nothing changed.
        """
        world = self.world
        generation = world.generation
        world.update(belief, *places)
        self.resized = world.generation != generation
        rows, columns = world.padded.shape
        if self.resized:
            self._clearance = Clearance(world, self._radius)
        box = world.box
        if box is not None:
            changed, _ = self._clearance.refresh(world.padded, box, world.lost)
            box = changed if changed[1] >= 0 else None
        self.clear = self._clearance.grid
        return (0, rows - 1, 0, columns - 1) if self.resized else box

    def at_ease(self, position: Position) -> bool:
        """Whether straight lines may begin at a position: all points of its cell are clear."""
        return self.possibly_free(position, position)

    def possibly_free(self, a: Position, b: Position) -> bool:
        """Whether the straight segment between two places inside the grid touches only cells that may be clear."""
        points = (*self.world.subcells(a), *self.world.subcells(b))
        return bool(blocker(self.clear.reshape(-1), self.clear.shape[1], *points) == CLEAR)

    def joined(self, a: Position, b: Position) -> bool:
        """Whether the robot might get from one place to another, or from clear space next to them."""
        cells = [nearest_clear(self.world, self.clear, place, self._reach) for place in (a, b)]
        return all(cell >= 0 for cell in cells) and bool(connected(self.clear, *cells))

    def near(self, position: Position, metres: float) -> Position | None:
        """Return the nearest place `at_ease` that a position sees within some distance; None without one."""
        cell = nearest_clear(self.world, self.clear, position, self._reach, worst=CLEAR_CELL)
        if cell < 0:
            return None
        place = to_metres(self.world, _middles(np.array([cell]), self.clear.shape[1]))[0]
        return place if np.hypot(place[0] - position[0], place[1] - position[1]) <= metres else None

    def way(self, start: Position, goal: Position) -> list[Position] | None:
        """Return a short way that the robot might drive, from cell to cell; see `possible_way`."""
        return possible_way(self.world, self.clear, start, goal, self._reach)


def possible_way(
    world: OptimisticBelief, clear: NDArray[np.int8], start: Position, goal: Position, reach: int
) -> list[Position] | None:
    """Search a short way that the robot might drive.

    Args:
        world: at its best.
        clear: where the robot fits in it, int8, shape of its padded grid.
        start: metres.
        goal: metres.
        reach: a place where the robot does not fit stands for the nearest one where it does, within so many cells.

    Returns:
        Corners without the start, metres, the goal last, or the place that stands for it; None without a way.
    """
    first, last = (nearest_clear(world, clear, place, reach) for place in (start, goal))
    if first < 0 or last < 0:
        return None
    corners = cell_path(clear, first, last)
    if not len(corners):
        return None
    way = to_metres(world, corners)
    if len(way) > 1 and hypot(way[0][0] - start[0], way[0][1] - start[1]) <= TOLERANCE:
        way = way[1:]
    if blocker(clear.reshape(-1), clear.shape[1], *world.subcells(goal), *world.subcells(goal)) == CLEAR:
        way.append(goal)
    return way


def nearest_clear(
    world: OptimisticBelief, clear: NDArray[np.int8], position: Position, reach: int, worst: int = TIGHT
) -> int:
    """Return the cell of a position, or the nearest one where the robot fits and that the position sees.

    Args:
        world: at its best.
        clear: where the robot fits in it.
        position: metres, inside the grid.
        reach: rows and columns away at most.
        worst: CLEAR_CELL asks for cells all of whose points are clear.

    Returns:
        Flat number of the cell, -1 without one.
    """
    width = clear.shape[1]
    row, column = world.cell(position)
    if 0 <= clear[row, column] <= worst:
        return row * width + column
    top, left = max(row - reach, 0), max(column - reach, 0)
    window = clear[top : row + reach + 1, left : column + reach + 1]
    rows, columns = np.nonzero((window >= 0) & (window <= worst))
    cells = (rows + top) * width + columns + left
    here = world.subcells(position)
    middles = _middles(cells, width)
    order = np.argsort(((middles - here) ** 2).sum(axis=1), kind="stable")
    flat = world.padded.reshape(-1)
    for k in order:
        if blocker(flat, width, *here, int(middles[k, 0]), int(middles[k, 1])) == CLEAR:
            return int(cells[k])
    return -1


def to_metres(world: OptimisticBelief, points: NDArray[np.int64]) -> list[Position]:
    """Return points in subcells of the padded grid, shape (n, 2), as positions in metres."""
    places = (points / SUBCELLS - 1.0) * world.resolution + np.array(world.origin)
    return [(float(x), float(y)) for x, y in places]


def _middles(cells: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Return the middles of cells, subcells, shape (n, 2)."""
    return np.stack([cells % width, cells // width], axis=1).astype(np.int64) * SUBCELLS + SUBCELLS // 2
