"""The eight symmetries: a group that moves positions alone; features follow, choices and labels stay."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.messages.validation import check_choices, check_observations
from common.network.graph_arrays import GraphArrays
from common.observations.feature_sets import FEATURE_NAMES
from common.observations.observation import ObservationBatch
from learner.algorithm.augment import MATRICES, SYMMETRIES, augment, transform_observations
from tests.observations import random_batch
from tests.transitions import random_transitions

seeds = st.integers(0, 2**32 - 1)
FOLLOWING = ("x", "y", "target_direction_x", "target_direction_y")
FOLLOW = [FEATURE_NAMES["extended"].index(name) for name in FOLLOWING]
INVARIANT = [column for column, name in enumerate(FEATURE_NAMES["extended"]) if name not in FOLLOWING]
INDEX = {tuple(matrix.ravel()): s for s, matrix in enumerate(MATRICES)}


def equal(a: ObservationBatch, b: ObservationBatch) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(ObservationBatch))


def test_matrices_are_the_dihedral_group() -> None:
    assert len(INDEX) == SYMMETRIES
    assert all(tuple((a @ b).ravel()) in INDEX for a in MATRICES for b in MATRICES)
    assert MATRICES[0].tolist() == [[1, 0], [0, 1]]


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_symmetries_compose_and_undo(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, 4, (2, 25), image=True)
    first, second = rng.integers(SYMMETRIES, size=(2, 4))
    once = transform_observations(batch, first)
    product = np.array([INDEX[tuple((MATRICES[b] @ MATRICES[a]).ravel())] for a, b in zip(first, second, strict=True)])
    assert equal(transform_observations(once, second), transform_observations(batch, product))
    inverse = np.array([INDEX[tuple(MATRICES[a].T.ravel())] for a in first])
    assert equal(transform_observations(once, inverse), batch)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_observations_stay_valid_and_features_follow(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, 3, (2, 25), image=True)
    symmetries = rng.integers(SYMMETRIES, size=3)
    moved = transform_observations(batch, symmetries)
    check_observations(moved, "moved")
    assert {getattr(moved, f.name).dtype == getattr(batch, f.name).dtype for f in fields(ObservationBatch)} == {True}
    before = GraphArrays.from_observations(batch, NetworkConfig())
    after = GraphArrays.from_observations(moved, NetworkConfig())
    np.testing.assert_array_equal(after.neighbours, before.neighbours)
    np.testing.assert_array_equal(after.features[:, INVARIANT], before.features[:, INVARIANT])
    matrices = np.repeat(MATRICES[symmetries], np.diff(before.node_ptr), axis=0)
    vectors = before.features[:, FOLLOW].reshape(-1, 2, 2)
    expected = np.einsum("nij,nvj->nvi", matrices, vectors).reshape(-1, 4)
    np.testing.assert_allclose(after.features[:, FOLLOW], expected, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_choices_and_labels_stay_as_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_transitions(rng, 4, (2, 25), labelled=0.7)
    moved = augment(batch, rng)
    for field in fields(batch):
        if field.name not in ("observations", "next_observations"):
            assert getattr(moved, field.name) is getattr(batch, field.name)
    check_choices(moved.observations, moved.beacons, moved.waypoints, None, "moved")
    for k in range(4):
        for before, after in (
            (batch.observations[k], moved.observations[k]),
            (batch.next_observations[k], moved.next_observations[k]),
        ):
            np.testing.assert_array_equal(np.abs(before.steps).sum(axis=1), np.abs(after.steps).sum(axis=1))
            np.testing.assert_array_equal(before.waypoint_nodes(), after.waypoint_nodes())


@given(symmetry=st.integers(0, SYMMETRIES - 1), x=st.integers(-24, 23), y=st.integers(-24, 23))
def test_images_turn_with_what_they_show(symmetry: int, x: int, y: int) -> None:
    """A mark at the pixel that holds (x + 1/2, y + 1/2) moves as a viewpoint there does."""
    batch = random_batch(np.random.default_rng(0), 1, (2, 2), image=True)
    image = np.zeros((48, 48), dtype=np.uint8)
    image[y + 24, x + 24] = 15
    batch.image[0, 1] = image.ravel()
    moved = transform_observations(batch, np.array([symmetry])).image[0, 1].reshape(48, 48)
    (row,), (column,) = np.nonzero(moved)
    assert [2 * column - 47, 2 * row - 47] == (MATRICES[symmetry] @ [2 * x + 1, 2 * y + 1]).tolist()


def test_both_observations_of_a_transition_turn_alike() -> None:
    rng = np.random.default_rng(0)
    batch = random_transitions(rng, 50, (5, 6), targets=("none",))
    moved = augment(batch, rng)
    drawn = []
    for k in range(50):
        fits = [
            {s for s in range(SYMMETRIES) if np.array_equal(before[k].offsets @ MATRICES[s].T, after[k].offsets)}
            for before, after in (
                (batch.observations, moved.observations),
                (batch.next_observations, moved.next_observations),
            )
        ]
        assert fits[0] & fits[1]
        drawn += fits[0] & fits[1] if len(fits[0] & fits[1]) == 1 else []
    assert set(drawn) == set(range(SYMMETRIES))
