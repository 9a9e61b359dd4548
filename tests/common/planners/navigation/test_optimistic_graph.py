from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from common.planners.navigation.graph_search import NO_WAY, GoalGraph, a_star
from common.planners.navigation.incremental_search import IncrementalSearch
from common.planners.navigation.optimistic_graph import OptimisticGraph
from tests.common.planners.places import shortest
from tests.effort import examples

Position = tuple[float, float]
FIELDS = ("x", "y", "pointer", "neighbours", "costs", "goal_costs", "heuristic")


def config_of(radius: float, spacing: float = 2.0) -> MappingConfig:
    return MappingConfig(resolution=0.5, robot_radius=radius, viewpoint_spacing=spacing, sensor_range=6.0)


def random_cells(random: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Walls, clutter and what was not seen, in patches as scans leave them."""
    cells = np.zeros(shape, dtype=np.int8)
    for _ in range(int(random.integers(1, 5))):
        row, column = (int(random.integers(size)) for size in shape)
        height, width = random.integers(1, 9, 2)
        cells[row : row + height, column : column + width] = random.choice([UNKNOWN, UNKNOWN, OCCUPIED])
    cells[random.random(shape) < 0.03] = OCCUPIED
    cells[random.random(shape) < 0.03] = UNKNOWN
    return cells


def positions(graph: OptimisticGraph) -> list[Position]:
    return [graph.position(vertex) for vertex in range(len(graph.graph.x))]


def edges(graph: GoalGraph) -> dict[tuple[int, int], int]:
    rows = np.repeat(np.arange(len(graph.x)), np.diff(graph.pointer))
    return {(a, b): c for a, b, c in zip(rows.tolist(), graph.neighbours.tolist(), graph.costs.tolist(), strict=True)}


def check_rules(graph: OptimisticGraph, mapper: Mapper, scanned: set[Position], closed: set[Position]) -> None:
    """Everything that a vertex promises, found out the slow way."""
    found = edges(graph.graph)
    places = np.array(positions(graph))
    nodes = {tuple(np.round(place, 6)): node for node, place in enumerate(mapper.viewpoints)}
    of_vertex = {v: nodes[key] for v, place in enumerate(places) if (key := tuple(np.round(place, 6))) in nodes}
    assert len(of_vertex) == len(mapper.viewpoints)
    done = {v for v, place in enumerate(places) if tuple(np.round(place, 6)) in scanned}
    shut = {v for v, place in enumerate(places) if tuple(np.round(place, 6)) in closed}
    of_node = {node: vertex for vertex, node in of_vertex.items()}
    pairs = {(of_node[a], of_node[b]) for a, b in mapper.edges.tolist()}
    known = {(a, b) for a, b in pairs | {(b, a) for a, b in pairs} if not {a, b} & shut}
    assert all(found.get((b, a)) == cost for (a, b), cost in found.items())
    assert known <= found.keys()
    step, origin = mapper.belief.resolution, np.array(mapper.belief.origin)
    known_cells = mapper.belief.padded
    for number, ((a, b), cost) in enumerate(found.items()):
        straight = float(np.hypot(*(places[a] - places[b])))
        assert not {a, b} & shut
        assert cost / 65536 * step >= straight - 1e-6
        if {a, b} & done:
            # From where the robot has looked around, only what is known leads on.
            assert (a, b) in known
        # A known viewpoint is joined with the possible one of its piece as the crow flies.
        apart = (np.floor_divide(places[a], 2.0) != np.floor_divide(places[b], 2.0)).any()
        if number % 7 == 0 and cost / 65536 * step < straight + 1e-3 and apart:
            part = np.linspace(0.0, 1.0, 50)[:, None]
            cells = ((1 - part) * places[a] + part * places[b] - origin) / step
            columns, rows = np.clip(np.floor(cells).astype(int) + 1, 0, np.array(known_cells.shape)[::-1] - 1).T
            assert (known_cells[rows, columns] != OCCUPIED).all()


@settings(max_examples=examples(40))
@given(seed=st.integers(0, 2**32 - 1), radius=st.sampled_from([0.0, 0.5, 0.8]))
def test_the_graph_follows_the_belief_and_both_searches_agree(seed: int, radius: float) -> None:
    random = np.random.default_rng(seed)
    config = config_of(radius)
    target = (float(random.uniform(0, 12)), float(random.uniform(0, 10)))
    mapper = Mapper(config, lattice_origin=(1.0, 1.0), target=target)
    mapper.belief.assign(random_cells(random, (20, 24)), (0.0, 0.0))
    graph, search = OptimisticGraph(config, target), IncrementalSearch()
    scanned: set[Position] = set()
    closed: set[Position] = set()
    for step in range(5):
        free = np.argwhere(mapper.belief.cells == FREE)
        row, column = free[int(random.integers(len(free)))]
        x, y = mapper.belief.origin
        mapper.update(Pose(x + (column + 0.5) * 0.5, y + (row + 0.5) * 0.5))
        if not mapper.stuck:
            look = bool(random.random() < 0.5)
            here = tuple(np.round(mapper.position(mapper.robot), 6))
            if look:
                scanned.add(here)
            start = graph.update(mapper, scanned=look)
            assert graph.position(start) == pytest.approx(mapper.position(mapper.robot), abs=1e-6)
            check_rules(graph, mapper, scanned, closed)
            fresh = OptimisticGraph(config, target)
            fresh._scanned, fresh._closed = set(graph._scanned), set(graph._closed)
            # The grid underneath need not begin at the same place.
            assert fresh.update(mapper, scanned=False) == start or fresh.world.shape != graph.world.shape
            if fresh.world.shape == graph.world.shape:
                for field in FIELDS:
                    assert np.array_equal(getattr(fresh.graph, field), getattr(graph.graph, field)), field
            length, path, _ = a_star(graph.graph, start)
            assert length == shortest(graph.graph, start) == search.replan(graph.graph, start)
            assert len(path) == 0 or graph.position(path[0]) == graph.position(start)
            if random.random() < 0.3:
                closed.add(here)
                graph.close(start)
        low = -4 if step == 2 else 0
        part = random_cells(random, (int(random.integers(1, 8)), int(random.integers(1, 8))))
        # Sometimes beyond the belief, so that it grows.
        mapper.belief.assign(part, (0.5 * int(random.integers(low, 16)), 0.5 * int(random.integers(low, 12))))


def corridor(known: int) -> Mapper:
    """A corridor of 2 m, 20 m long, of which so many cells are known; the target is at its far end."""
    mapper = Mapper(config_of(0.0), lattice_origin=(1.0, 1.0), target=(19.0, 1.0))
    cells = np.full((6, 40), UNKNOWN, dtype=np.int8)
    cells[:, :known] = OCCUPIED
    cells[1:5, 1:known] = FREE
    mapper.belief.assign(cells, (0.0, -0.5))
    mapper.update(Pose(1.0, 1.0))
    return mapper


def test_what_was_not_seen_is_hoped_for_and_what_was_seen_is_not() -> None:
    mapper = corridor(20)
    graph = OptimisticGraph(config_of(0.0), (19.0, 1.0))
    start = graph.update(mapper, scanned=True)
    length, path, _ = a_star(graph.graph, start)
    assert length == 18 * 2 * 65536
    assert [graph.position(vertex)[1] for vertex in path] == [1.0] * len(path)
    cells = np.full((6, 1), OCCUPIED, dtype=np.int8)
    mapper.belief.assign(cells, (9.5, -0.5))
    mapper.update(Pose(1.0, 1.0))
    start = graph.update(mapper, scanned=True)
    assert a_star(graph.graph, start)[0] == NO_WAY


def test_a_robot_that_looked_around_hopes_for_nothing_there_any_more() -> None:
    mapper = corridor(11)
    graph = OptimisticGraph(config_of(0.0), (19.0, 1.0))
    last = int(np.argmax(mapper.viewpoints[:, 0]))
    mapper.update(Pose(*mapper.position(last)))
    start = graph.update(mapper, scanned=False)
    assert a_star(graph.graph, start)[0] < NO_WAY
    start = graph.update(mapper, scanned=True)
    _, path, _ = a_star(graph.graph, start)
    # There is no second place from where to look: only what is known leads on from there.
    assert not path or mapper.joined(mapper.robot, graph.known_node(path[1]))


def test_a_leg_to_the_target_can_be_given_up() -> None:
    mapper = corridor(40)
    graph = OptimisticGraph(config_of(0.0), (19.0, 1.0))
    start = graph.update(mapper, scanned=True)
    before, path, _ = a_star(graph.graph, start)
    graph.close_leg(path[-1])
    start = graph.update(mapper, scanned=True)
    after, path, _ = a_star(graph.graph, start)
    assert before <= after < NO_WAY
    while path:
        graph.close_leg(path[-1])
        start = graph.update(mapper, scanned=True)
        _, path, _ = a_star(graph.graph, start)
    assert (graph.graph.goal_costs == NO_WAY).all()
