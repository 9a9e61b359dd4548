"""FAR: shortest paths in a visibility graph of obstacles that is corrected after every scan."""

from __future__ import annotations

from math import isfinite

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import Box
from common.planners.base import Plan, Position, Status
from common.planners.free_space import FreeSpacePlanner
from common.planners.visibility_graph import VisibilityGraph


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

    def route(self, pose: Pose, target: Position, changed: Box | None) -> list[Position] | None:
        """Correct the graph and search it; see `FreeSpacePlanner.route`."""
        grid = self.grid
        if grid.resized:
            self._graph.clear()
        if changed is not None:
            self._graph.update(grid.possible, changed)
        length, path = self._graph.path(grid.possible, grid.subcells(pose.position), grid.subcells(target))
        if not isfinite(length):
            return None
        step, (x, y) = grid.resolution, grid.origin
        corners = self._graph.corners[path, :2].tolist()
        return [(x + column * step, y + row * step) for column, row in corners] + [target]

    def no_route(self, mapper: Mapper, target: Position) -> Plan:
        """Say that every way is narrower than polygons can tell."""
        del mapper
        return Plan(
            Status.UNREACHABLE,
            reason=f"no way to the target ({target[0]:.2f}, {target[1]:.2f}) passes between the obstacles: what is "
            "narrower than two cells counts as closed",
        )
