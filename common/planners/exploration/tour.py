"""Shortest open tours through a few stops, by the routing solver of OR-Tools."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.system.extras import optional

# The solver counts in whole numbers; a distance is rounded to a centimetre.
UNITS_PER_METRE: Final = 100
# Stands for "no way" in the solver: far above any tour, far below an overflow of its sums.
NO_WAY: Final = 1 << 40


def open_tour(distances: NDArray[np.float64], end: int | None = None) -> list[int]:
    """Order stops so that the way from stop 0 through all others is short.

    The first solution joins the cheapest arcs, and the solver's local search (2-opt, Or-opt, Lin-Kernighan and others)
    improves it until no move helps. There is no time limit and no chance in it: equal distances give equal tours.

    Args:
        distances: metres, shape (n, n), infinite where no way leads; n >= 1.
        end: the last stop, or None where the tour may end anywhere.

    Returns:
        All stops 0 .. n - 1 in the order of the tour, 0 first.

    Raises:
        ConfigError: OR-Tools is not installed.
        ValueError: a stop cannot be reached from the others.
    """
    count = len(distances)
    if count <= 2 or (count == 3 and end not in (None, 0)):
        middle = [k for k in range(1, count) if k != end]
        return [0, *middle] if end in (None, 0) else [0, *middle, end]
    pywrapcp, enums = load_ortools()
    # One more stop, at no distance from any place where the tour may end, closes it.
    costs = np.zeros((count + 1, count + 1), dtype=np.int64)
    costs[:count, :count] = np.where(np.isfinite(distances), np.rint(distances * UNITS_PER_METRE), NO_WAY)
    if end is not None:
        costs[:count, count] = NO_WAY
        costs[end, count] = 0
    manager = pywrapcp.RoutingIndexManager(count + 1, 1, [0], [count])
    routing = pywrapcp.RoutingModel(manager)
    routing.SetArcCostEvaluatorOfAllVehicles(routing.RegisterTransitMatrix(costs.tolist()))
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = enums.FirstSolutionStrategy.PATH_CHEAPEST_ARC
    parameters.local_search_metaheuristic = enums.LocalSearchMetaheuristic.GREEDY_DESCENT
    solution = routing.SolveWithParameters(parameters)
    if solution is None or solution.ObjectiveValue() >= NO_WAY:
        raise ValueError("a stop of the tour cannot be reached from the others: leave unreachable stops out")
    order: list[int] = []
    at = routing.Start(0)
    while not routing.IsEnd(at):
        order.append(manager.IndexToNode(at))
        at = solution.Value(routing.NextVar(at))
    return order


def tour_length(distances: NDArray[np.float64], order: Sequence[int]) -> float:
    """Return the length of a way through stops in order, metres."""
    return float(sum(distances[a, b] for a, b in pairwise(order)))


def load_ortools() -> tuple[Any, ModuleType]:
    """Import the routing solver; ConfigError when it is missing.

    Returns:
        The modules ``pywrapcp`` and ``routing_enums_pb2``.
    """
    with optional("this planner", "planners", instead="use a planner without it (nearest, greedy, nbvp, dsvp)"):
        from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    return pywrapcp, routing_enums_pb2
