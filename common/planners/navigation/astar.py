"""A*, replanned at each decision: the work that D* Lite saves, and a check of its answers."""

from __future__ import annotations

from common.planners.navigation.base import GraphNavigator
from common.planners.navigation.graph_search import a_star


class AStarPlanner(GraphNavigator):
    """Follow a shortest path over the viewpoint graph, unknown space taken as free, replanned at each decision.

    P. E. Hart, N. J. Nilsson, B. Raphael: "A Formal Basis for the Heuristic Determination of Minimum Cost Paths", IEEE
    Transactions on Systems Science and Cybernetics, 1968.

    As published, with the straight distance to the target as heuristic; nothing is left out. Graph, costs and the
    treatment of unknown space are those of the planner "dstar_lite": the paths are equally long, and only where
    several are, the two may take different ones.
    """

    name = "astar"

    def search(self, start: int) -> tuple[int, list[int]]:
        """Search the shortest path; see `GraphNavigator.search`."""
        length, path, _ = a_star(self.graph.graph, start)
        return length, path
