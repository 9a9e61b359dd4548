"""Slots and pairs agree with the node numbers of observations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.network import reduction
from common.network.graph_arrays import GraphArrays
from common.observations.index import neighbour_table
from tests.observations import random_batch
from tests.paths import all_path_lengths, edge_lengths


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6), vanilla=st.booleans())
def test_sets_and_pairs(seed: int, count: int, vanilla: bool) -> None:
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, count, (2, 20))
    config = NetworkConfig(variant="vanilla" if vanilla else "hdplanner")
    arrays = GraphArrays.from_observations(batch, config)
    beacons = np.array([rng.choice(batch[k].beacon_nodes()) for k in range(count)], dtype=np.int32)
    waypoints = np.array([rng.choice(batch[k].waypoint_nodes()) for k in range(count)], dtype=np.int32)
    chosen = arrays.pairs[arrays.pair_index(beacons, waypoints)]
    np.testing.assert_array_equal(chosen[:, 0], np.arange(count))
    np.testing.assert_array_equal(arrays.waypoint_rows[chosen[:, 2]], arrays.node_ptr[:-1] + waypoints)
    expected = batch.robot if vanilla else beacons
    np.testing.assert_array_equal(arrays.beacon_rows[chosen[:, 1]], arrays.node_ptr[:-1] + expected)
    for k in range(count):
        waypoint_nodes = arrays.waypoint_rows[arrays.waypoint_ptr[k] : arrays.waypoint_ptr[k + 1]]
        np.testing.assert_array_equal(waypoint_nodes - arrays.node_ptr[k], batch[k].waypoint_nodes())
        if not vanilla:
            beacon_nodes = arrays.beacon_rows[arrays.beacon_ptr[k] : arrays.beacon_ptr[k + 1]]
            np.testing.assert_array_equal(beacon_nodes - arrays.node_ptr[k], batch[k].beacon_nodes())


def test_a_wrong_choice_is_named() -> None:
    batch = random_batch(np.random.default_rng(0), 3, (10, 10), ("none",))
    arrays = GraphArrays.from_observations(batch, NetworkConfig())
    beacons = np.array([batch[k].beacon_nodes()[0] for k in range(3)], dtype=np.int32)
    robots = batch.robot
    with pytest.raises(ValueError, match="observation 0 .* is no waypoint of it"):
        arrays.pair_index(beacons, robots)
    with pytest.raises(ValueError, match="is -1"):
        arrays.pair_index(np.full(3, -1, dtype=np.int32), np.full(3, -1, dtype=np.int32))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_toward_tells_which_waypoints_begin_a_shortest_path_to_a_beacon(seed: int) -> None:
    batch = random_batch(np.random.default_rng(seed), 2, (2, 20))
    arrays = GraphArrays.from_observations(batch, NetworkConfig(toward=True))
    table = neighbour_table(batch)
    every_path = list(all_path_lengths(batch, table))
    for (g, beacon, waypoint), found in zip(arrays.pairs, arrays.toward, strict=True):
        first, between = int(table.node_ptr[g]), every_path[g]
        target = len(between) - 1 if batch.has_target[g] else -1
        robot = int(batch.robot[g])
        b, w = int(arrays.beacon_rows[beacon]) - first, int(arrays.waypoint_rows[waypoint]) - first
        rest = 0.0 if w == b else (np.inf if w == target else between[w, b])
        step = edge_lengths(batch, table, g)[robot, w]
        expected = np.isfinite(between[robot, b]) and abs(step + rest - between[robot, b]) < 1e-6
        assert found == expected


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_tokens_keep_what_a_decision_turns_on(seed: int) -> None:
    batch = random_batch(np.random.default_rng(seed), 1, (20, 40))
    observation = batch[0]
    config = NetworkConfig(features="guided", graph="tokens")
    tokens = GraphArrays.from_observations(batch, config)
    reduced = GraphArrays.from_observations(batch, NetworkConfig(features="guided", graph="reduced"))
    # Up to a number of nodes the two are one.
    np.testing.assert_array_equal(tokens.nodes, reduced.nodes)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reduction, "MOST_NODES", 5)
        tokens = GraphArrays.from_observations(batch, config)
    assert set(tokens.nodes) <= set(reduced.nodes)
    assert {observation.robot, *observation.beacon_nodes(), *observation.waypoint_nodes()} <= set(tokens.nodes)
    assert set(observation.route.astype(int)) <= set(tokens.nodes)
    np.testing.assert_array_equal(tokens.nodes[tokens.waypoint_rows], observation.waypoint_nodes())
    np.testing.assert_array_equal(tokens.nodes[tokens.beacon_rows], observation.beacon_nodes())
