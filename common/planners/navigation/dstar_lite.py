"""D* Lite: the shortest path through what is known and what might be, repaired after every scan."""

from __future__ import annotations

from common.planners.base import Position
from common.planners.navigation.base import GraphNavigator
from common.planners.navigation.incremental_search import IncrementalSearch


class DStarLitePlanner(GraphNavigator):
    """Follow a shortest path over the viewpoint graph, unknown space taken as free, and repair it after each scan.

    S. Koenig, M. Likhachev: "D* Lite", AAAI Conference on Artificial Intelligence, 2002.

    As published: the final optimised version (figure 4), with its priority queue of two-part keys, the key modifier,
    rhs-values that are kept up to date, and the freespace assumption for what was not seen yet. Otherwise: the graph is
    the viewpoint graph (one edge is one decision, as for every planner here), whose vertices come and go, instead of an
    eight-connected grid of cells; costs are whole numbers (see `common.planners.navigation.graph_search`), so that
    repaired and fresh searches agree exactly; and an edge that a scan from one of its ends left in doubt counts as
    blocked, because the robot may not drive along it.
    """

    name = "dstar_lite"

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything; there is no chance in a search, so the seed plays no part."""
        super().begin(target, seed)
        self._search = IncrementalSearch()

    def search(self, start: int) -> tuple[int, list[int]]:
        """Repair the shortest path; see `GraphNavigator.search`."""
        length = self._search.replan(self.graph.graph, start)
        return length, self._search.path()
