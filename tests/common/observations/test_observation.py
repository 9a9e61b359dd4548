"""Observations survive stacking and selecting, and say who is where."""

from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.observations.observation import Observation, ObservationBatch
from tests.observations import observations


def same(a: Observation, b: Observation) -> bool:
    return all(np.array_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(Observation))


@given(st.lists(observations(15), min_size=1, max_size=5), st.data())
@settings(max_examples=50, deadline=None)
def test_a_batch_gives_back_what_was_stacked(held, data):
    batch = ObservationBatch.stack(held)
    assert len(batch) == len(held)
    assert all(same(batch[k], observation) for k, observation in enumerate(held))
    chosen = np.array(data.draw(st.lists(st.booleans(), min_size=len(held), max_size=len(held))))
    picked = batch.select(chosen)
    kept = [observation for observation, wanted in zip(held, chosen, strict=True) if wanted]
    assert len(picked) == len(kept)
    assert all(same(picked[k], observation) for k, observation in enumerate(kept))


@given(observations(40))
@settings(max_examples=60, deadline=None)
def test_waypoints_are_the_neighbours_of_the_robot_and_a_target_in_sight(observation):
    lower = np.repeat(np.arange(observation.viewpoints), observation.degree).tolist()
    expected = []
    for i, j in zip(lower, observation.neighbours.tolist(), strict=True):
        expected += [j] if i == observation.robot else [i] if j == observation.robot else []
    if observation.target_known and observation.robot in observation.target_links:
        expected.append(observation.viewpoints)
    assert observation.waypoint_nodes().tolist() == sorted(expected)


@given(observations(20))
@settings(max_examples=30, deadline=None)
def test_steps_are_positions_of_all_nodes(observation):
    assert observation.steps.shape == (observation.nodes, 2)
    assert not observation.steps[observation.robot].any()
    np.testing.assert_array_equal(observation.steps[: observation.viewpoints] * 64, observation.offsets)
    if observation.has_target:
        np.testing.assert_array_equal(observation.steps[-1], observation.target_offset)
