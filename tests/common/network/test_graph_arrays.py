"""Slots and pairs agree with the node numbers of observations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config.schema import NetworkConfig
from common.network.graph_arrays import GraphArrays
from tests.observations import random_batch


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
