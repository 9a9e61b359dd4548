"""Features say what their table says: checked against a slow, obvious computation."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.observations.feature_sets import FEATURE_NAMES
from common.observations.observation import STEP_UNITS, Observation, ObservationBatch
from tests.observations import observations, random_batch


def arrays_of(observation: Observation, features: str = "extended") -> GraphArrays:
    return GraphArrays.from_observations(ObservationBatch.stack([observation]), NetworkConfig(features=features))


def column(observation: Observation, name: str) -> np.ndarray:
    return arrays_of(observation).features[:, FEATURE_NAMES["extended"].index(name)]


def all_distances(observation: Observation) -> np.ndarray:
    """Floyd and Warshall over the viewpoints, then the target as an end point alone."""
    n = observation.viewpoints
    table = np.full((observation.nodes, observation.nodes), np.inf)
    np.fill_diagonal(table, 0.0)
    lower = np.repeat(np.arange(n), observation.degree)
    steps = observation.steps
    for edge, (i, j) in enumerate(zip(lower, observation.neighbours, strict=True)):
        table[i, j] = table[j, i] = np.hypot(*(steps[i] - steps[j]))
        if edge in observation.bent:
            table[i, j] = table[j, i] = observation.bent_length[list(observation.bent).index(edge)]
    for middle in range(n):
        table = np.minimum(table, table[:, middle, None] + table[None, middle])
    if observation.has_target:
        links = observation.target_links.astype(int)
        last = np.hypot(*(steps[links] - observation.target_offset).T)
        table[:n, n] = table[n, :n] = (table[:n, links] + last).min(axis=1, initial=np.inf)
    return table


@settings(max_examples=40, deadline=None)
@given(observations(25))
def test_graph_distances_and_paths(observation: Observation) -> None:
    distances = all_distances(observation)
    robot = observation.robot
    np.testing.assert_allclose(
        column(observation, "robot_graph_distance"), np.minimum(distances[robot] / 20, 8), atol=1e-5
    )
    useful = np.flatnonzero(observation.utility)
    np.testing.assert_allclose(
        column(observation, "useful_graph_distance"),
        np.minimum(distances[:, useful].min(axis=1) / 20, 8),
        atol=1e-5,
    )
    on_path = np.zeros(observation.nodes, dtype=bool)
    for beacon in observation.beacon_nodes():
        on_path |= np.abs(distances[robot] + distances[:, beacon] - distances[robot, beacon]) < 1e-6
    if observation.has_target and not observation.target_known:
        on_path[-1] = False
    np.testing.assert_array_equal(column(observation, "on_beacon_path"), on_path)
    if observation.has_target:
        np.testing.assert_allclose(
            column(observation, "target_graph_distance"), np.minimum(distances[-1] / 20, 8), atol=1e-5
        )


@settings(max_examples=30, deadline=None)
@given(observations(25))
def test_plain_columns(observation: Observation) -> None:
    n = observation.viewpoints
    np.testing.assert_allclose(column(observation, "x") * 20, observation.steps[:, 0].clip(-160, 160), atol=1e-4)
    np.testing.assert_allclose(np.expm1(column(observation, "utility")[:n] * 4), observation.utility, rtol=1e-4)
    np.testing.assert_array_equal(column(observation, "visited")[:n], observation.visited)
    np.testing.assert_array_equal(np.flatnonzero(column(observation, "beacon")), observation.beacon_nodes())
    np.testing.assert_array_equal(np.flatnonzero(column(observation, "robot")), [observation.robot])
    np.testing.assert_array_equal(column(observation, "target").sum(), observation.has_target)
    lower = np.repeat(np.arange(n), observation.degree)
    degrees = np.bincount(np.concatenate([lower, observation.neighbours]), minlength=n)
    np.testing.assert_allclose(column(observation, "degree")[:n], np.minimum(degrees / 20, 2), rtol=1e-6)
    features = arrays_of(observation).features
    assert np.isfinite(features).all()
    assert np.abs(features).max() <= 8.0
    np.testing.assert_array_equal(arrays_of(observation, "paper").features, features[:, :10])


@settings(max_examples=40, deadline=None)
@given(observations(25))
def test_guided_columns(observation: Observation) -> None:
    features = arrays_of(observation, "guided").features
    names = FEATURE_NAMES["guided"]
    found = {name: features[:, names.index(name)] for name in names}
    n = observation.viewpoints
    steps = observation.steps
    expected = np.zeros((observation.nodes, 3))
    length, here = 0.0, observation.robot
    for there in observation.route.astype(int):
        length += float(np.hypot(*(steps[there] - steps[here])))
        if not expected[there, 0]:
            expected[there, :2] = 1.0, min(length / 20, 8.0)
        here = there
    if len(observation.route):
        expected[observation.route[0], 2] = 1.0
    columns = [found[name] for name in ("on_route", "route_distance", "route_next")]
    np.testing.assert_allclose(np.stack(columns, axis=1), expected, atol=1e-5)
    np.testing.assert_allclose(found["reach"], observation.reach / 10, rtol=1e-6)
    # Sixteen cells to a step count once.
    metres = observation.utility * observation.cell * 16
    np.testing.assert_allclose(np.expm1(found["utility"][:n] * 4), metres, rtol=1e-4, atol=1e-5)
    assert np.isfinite(features).all()
    assert np.abs(features).max() <= 8.0


def test_batches_hold_what_single_observations_hold() -> None:
    batch = random_batch(np.random.default_rng(0), 8)
    together = GraphArrays.from_observations(batch, NetworkConfig())
    for k in range(len(batch)):
        alone = arrays_of(batch[k])
        rows = slice(int(together.node_ptr[k]), int(together.node_ptr[k + 1]))
        np.testing.assert_array_equal(together.features[rows], alone.features)
        shifted = np.where(alone.neighbours >= 0, alone.neighbours + rows.start, -1)
        np.testing.assert_array_equal(together.neighbours[rows], shifted)


def test_a_crowded_viewpoint_has_a_bounded_degree_and_all_its_neighbours() -> None:
    """A hub with 60 viewpoints around it: a wider table than that of any lattice."""
    count = 61
    angles = np.linspace(0, 2 * np.pi, count - 1, endpoint=False)
    offsets = np.vstack([[0, 0], np.rint(STEP_UNITS * np.stack([np.cos(angles), np.sin(angles)], axis=1))])
    observation = Observation(
        offsets=offsets.astype(np.int16),
        utility=np.ones(count, dtype=np.uint16),
        visited=np.zeros(count, dtype=np.bool_),
        beacon=np.arange(count) == 1,
        degree=np.where(np.arange(count) == 0, count - 1, 0).astype(np.uint8),
        neighbours=np.arange(1, count, dtype=np.uint16),
        bent=np.array([2], dtype=np.uint32),
        bent_length=np.array([40.0], dtype=np.float32),
        robot=0,
        has_target=False,
        target_known=False,
        target_offset=np.zeros(2, dtype=np.float32),
        target_links=np.zeros(0, dtype=np.uint16),
        cell=0.0625,
        reach=5.0,
        route=np.zeros(0, dtype=np.uint16),
    )
    np.testing.assert_allclose(column(observation, "degree"), [2.0] + [0.05] * 60)
    distances = column(observation, "robot_graph_distance") * 20
    np.testing.assert_allclose(np.delete(distances, [0, 3]), 1.0, atol=0.02)
    assert distances[3] == 40.0
    graph = arrays_of(observation)
    assert graph.neighbours.shape == (count, count - 1 + 2)
    assert graph.nodes[graph.waypoint_rows].tolist() == list(range(1, count))
