"""Features say what their table says: checked against a slow, obvious computation."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from common.config.schema import NetworkConfig
from common.features import FEATURE_NAMES
from common.network.graph_arrays import GraphArrays
from common.observation import NEIGHBOUR_OFFSETS, Observation, ObservationBatch
from tests.observations import observations, random_batch


def arrays_of(observation: Observation, features: str = "extended") -> GraphArrays:
    return GraphArrays.from_observations(ObservationBatch.stack([observation]), NetworkConfig(features=features))


def column(observation: Observation, name: str) -> np.ndarray:
    return arrays_of(observation).features[:, FEATURE_NAMES["extended"].index(name)]


def all_distances(observation: Observation) -> np.ndarray:
    """Floyd and Warshall over the viewpoints, then the target as an end point alone."""
    n = observation.viewpoints
    number = {(int(x), int(y)): i for i, (x, y) in enumerate(observation.offsets)}
    table = np.full((observation.nodes, observation.nodes), np.inf)
    np.fill_diagonal(table, 0.0)
    for i, (x, y) in enumerate(observation.offsets):
        for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS):
            if int(observation.edges[i]) >> k & 1:
                table[i, number[int(x + dx), int(y + dy)]] = np.hypot(dx, dy)
    for middle in range(n):
        table = np.minimum(table, table[:, middle, None] + table[None, middle])
    if observation.has_target:
        links = observation.target_links.astype(int)
        steps = np.hypot(*(observation.offsets[links] - observation.target_offset).T)
        table[:n, n] = table[n, :n] = (table[:n, links] + steps).min(axis=1, initial=np.inf)
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
    np.testing.assert_allclose(column(observation, "x")[:n] * 20, observation.offsets[:, 0], atol=1e-4)
    np.testing.assert_allclose(np.expm1(column(observation, "utility")[:n] * 4), observation.utility, rtol=1e-4)
    np.testing.assert_array_equal(column(observation, "visited")[:n], observation.visited)
    np.testing.assert_array_equal(np.flatnonzero(column(observation, "beacon")), observation.beacon_nodes())
    np.testing.assert_array_equal(np.flatnonzero(column(observation, "robot")), [observation.robot])
    np.testing.assert_array_equal(column(observation, "target").sum(), observation.has_target)
    bits = [int(mask).bit_count() / 20 for mask in observation.edges]
    np.testing.assert_allclose(column(observation, "degree")[:n], bits)
    features = arrays_of(observation).features
    assert np.isfinite(features).all()
    assert np.abs(features).max() <= 8.0
    np.testing.assert_array_equal(arrays_of(observation, "paper").features, features[:, :10])


def test_batches_hold_what_single_observations_hold() -> None:
    batch = random_batch(np.random.default_rng(0), 8)
    together = GraphArrays.from_observations(batch, NetworkConfig())
    for k in range(len(batch)):
        alone = arrays_of(batch[k])
        rows = slice(int(together.node_ptr[k]), int(together.node_ptr[k + 1]))
        np.testing.assert_array_equal(together.features[rows], alone.features)
        shifted = np.where(alone.neighbours >= 0, alone.neighbours + rows.start, -1)
        np.testing.assert_array_equal(together.neighbours[rows], shifted)
