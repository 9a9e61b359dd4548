"""FAR: shortest paths in a visibility graph of obstacles that is corrected after every scan."""

from __future__ import annotations

from math import ceil, isfinite

import numpy as np

from common.mapping.clearance import CLEAR_CELL
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import FREE, OCCUPIED, Box
from common.planners.base import Position
from common.planners.navigation.free_space import FreeSpacePlanner
from common.planners.navigation.possible_space import to_metres
from common.planners.navigation.visibility_graph import VisibilityGraph


class FarPlanner(FreeSpacePlanner):
    """Follow a shortest path in the visibility graph of all obstacles seen so far, unknown space taken as free.

    F. Yang, C. Cao, H. Zhu, J. Oh, J. Zhang: "FAR Planner: Fast, Attemptable Route Planner using Dynamic Visibility
    Update", IEEE/RSJ International Conference on Intelligent Robots and Systems (IROS), 2022.

    As published: obstacles become polygons (widened, traced, simplified), their convex corners are the vertices; edges
    that run into a polygon at one of their ends are left out before they are tested; the graph is kept between scans
    and only vertices and edges that a scan can have touched are made or tested anew; robot and target join it at each
    decision; and the planner attempts ways through unknown space, and turns round where an attempt fails.

    Left out: the separate local graph around the robot and its merging into the global one by distance and votes,
    because scans are merged in the belief here, exactly, and polygons are traced from it as a whole; the check of
    edges against polygons in favour of an exact one against cells; the removal of vertices that were moving obstacles,
    for the belief holds none; several layers of height; and the preference of known ways over shorter attempts. Of the
    path, only the part that is known to be free and no longer than one edge of the viewpoint graph is driven, as for
    every planner here.
    """

    name = "far"

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything; there is no chance in it, so the seed plays no part."""
        super().begin(target, seed)
        self._graph = VisibilityGraph()

    def take_in(self, changed: Box | None) -> None:
        """Correct the graph."""
        clear = self.space.clear
        if self.space.resized:
            self._graph.clear()
            self._cells = np.zeros(clear.shape, dtype=np.int8)
        if changed is not None:
            # The end of the grid is no obstacle: nothing is known there.
            ring = ceil(self.config.robot_radius / self.config.resolution) + 2
            rows, columns = clear.shape
            part = np.s_[
                max(changed[0], ring) : min(changed[1] + 1, rows - ring),
                max(changed[2], ring) : min(changed[3] + 1, columns - ring),
            ]
            self._cells[part] = np.where(clear[part] == CLEAR_CELL, FREE, OCCUPIED)
            self._graph.update(self._cells, changed)

    def route(self, start: Position, goal: Position) -> list[Position] | None:
        """Search the graph; see `FreeSpacePlanner.route`."""
        world = self.space.world
        length, path = self._graph.path(self._cells, world.subcells(start), world.subcells(goal))
        if not isfinite(length):
            return None
        corners = self._graph.corners[path, :2].astype(np.int64) * SUBCELLS
        return [*to_metres(world, corners), goal]
