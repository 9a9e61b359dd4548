"""The eight symmetries: a group, valid observations, labels that follow, and a policy's view of the same world."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config.schema import NetworkConfig
from common.features import FEATURE_NAMES
from common.network.graph_arrays import GraphArrays
from common.observation import NEIGHBOUR_COUNT, NEIGHBOUR_OFFSETS, ObservationBatch
from learner.algorithm.augment import BITS, MATRICES, SYMMETRIES, augment, transform_observations, transform_transitions
from tests.observations import random_batch
from tests.transitions import random_transitions

seeds = st.integers(0, 2**32 - 1)
FOLLOWING = {"x", "y", "target_direction_x", "target_direction_y"}
INVARIANT = [column for column, name in enumerate(FEATURE_NAMES["extended"]) if name not in FOLLOWING]


def equal(a: ObservationBatch, b: ObservationBatch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(ObservationBatch))


def test_matrices_are_the_dihedral_group() -> None:
    table = {tuple(m.ravel()) for m in MATRICES}
    assert len(table) == SYMMETRIES
    assert all(tuple((a @ b).ravel()) in table for a in MATRICES for b in MATRICES)
    for s in range(SYMMETRIES):
        moved = NEIGHBOUR_OFFSETS @ MATRICES[s].T
        np.testing.assert_array_equal(NEIGHBOUR_OFFSETS[BITS[s]], moved)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_symmetries_compose_and_undo(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, 4, (2, 25))
    first, second = rng.integers(SYMMETRIES, size=(2, 4))
    once, numbers = transform_observations(batch, first)
    twice, _ = transform_observations(once, second)
    index = {tuple(m.ravel()): s for s, m in enumerate(MATRICES)}
    product = np.array([index[tuple((MATRICES[b] @ MATRICES[a]).ravel())] for a, b in zip(first, second, strict=True)])
    assert equal(twice, transform_observations(batch, product)[0])
    inverse = np.array([index[tuple(MATRICES[a].T.ravel())] for a in first])
    back, _ = transform_observations(once, inverse)
    canonical, _ = transform_observations(batch, np.zeros(4, dtype=np.int64))
    assert equal(back, canonical)
    ends = np.cumsum(batch.count)
    for part in np.split(numbers, ends[:-1]):
        np.testing.assert_array_equal(np.sort(part), np.arange(len(part)))


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_observations_stay_valid_and_features_follow(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, 3, (2, 25))
    moved, numbers = transform_observations(batch, rng.integers(SYMMETRIES, size=3))
    before = GraphArrays.from_observations(batch, NetworkConfig())
    after = GraphArrays.from_observations(moved, NetworkConfig())
    first = np.cumsum(batch.count) - batch.count
    for k in range(3):
        offsets = moved[k].offsets.astype(int)
        keys = offsets[:, 1] * 10_000 + offsets[:, 0]
        assert (np.diff(keys) > 0).all()
        assert tuple(offsets[moved[k].robot]) == (0, 0)
        old = np.arange(batch[k].nodes)
        new = np.append(numbers[first[k] : first[k] + batch[k].viewpoints], batch[k].viewpoints)[: len(old)]
        rows = before.features[before.node_ptr[k] + old][:, INVARIANT]
        np.testing.assert_allclose(after.features[after.node_ptr[k] + new][:, INVARIANT], rows, atol=1e-5)
    assert (
        np.sort((after.neighbours[:, :NEIGHBOUR_COUNT] >= 0).sum(1))
        == np.sort((before.neighbours[:, :NEIGHBOUR_COUNT] >= 0).sum(1))
    ).all()


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_choices_and_labels_follow(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_transitions(rng, 4, (2, 25), labelled=0.7)
    moved = augment(batch, rng)
    at = 0
    for k in range(4):
        before, after = batch.observations[k], moved.observations[k]
        for old, new in ((batch.beacons[k], moved.beacons[k]), (batch.waypoints[k], moved.waypoints[k])):
            assert (old == before.viewpoints) == (new == after.viewpoints)
            if old < before.viewpoints:
                assert np.abs(np.sort(np.abs(before.offsets[old])) - np.sort(np.abs(after.offsets[new]))).max() == 0
                assert before.utility[old] == after.utility[new]
        assert moved.beacons[k] in after.beacon_nodes()
        assert moved.waypoints[k] in after.waypoint_nodes()
        size = len(before.waypoint_nodes())
        if batch.labels is not None and moved.labels is not None:
            ours = dict(zip(before.waypoint_nodes(), batch.labels.cost[at : at + size], strict=True))
            theirs = dict(zip(after.waypoint_nodes(), moved.labels.cost[at : at + size], strict=True))
            assert theirs[moved.waypoints[k]] == ours[batch.waypoints[k]]
            assert sorted(theirs.values()) == sorted(ours.values())
            assert (moved.labels.beacon[k] == -1) == (batch.labels.beacon[k] == -1)
        at += size
    same = transform_transitions(batch, np.zeros(4, dtype=np.int64))
    np.testing.assert_array_equal(same.waypoints, batch.waypoints)
