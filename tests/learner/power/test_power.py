"""A machine that loses its power at any moment, on a disk that keeps nothing but what was synced."""

import random

import pytest

from tests.learner.power.disk_model import Kept, selection
from tests.learner.power.failures import CannotRecordError, any_moments, fail, moments_between_syncs, record
from tests.learner.power.victim import EPISODES


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    try:
        return record(tmp_path_factory.mktemp("power"))
    except CannotRecordError as error:
        pytest.skip(str(error))


def test_a_power_failure_costs_nothing_that_was_acknowledged(recording, tmp_path):
    assert sum(operation.first.startswith(b"stored") for operation in recording[2]) == 3 * EPISODES
    assert fail(recording, any_moments(recording, 8, seed=0), seed=0, folder=tmp_path) == [set()] * 8


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_200_power_failures_cost_nothing_that_was_acknowledged(recording, tmp_path):
    assert fail(recording, any_moments(recording, 200, seed=1), seed=1, folder=tmp_path) == [set()] * 200


def test_acknowledging_from_memory_costs_some(recording, tmp_path):
    """So the failures of these tests do take what is not synced."""
    moments = moments_between_syncs(recording, 5, seed=0)
    lost = fail(recording, moments, seed=0, folder=tmp_path, word="taken", kept=[Kept.NONE])
    assert all(lost)
    assert sum(map(len, lost)) < 5 * 3 * EPISODES


@pytest.mark.parametrize(
    ("kept", "numbers"), [(Kept.NONE, {0}), (Kept.ALL, {3}), (Kept.EARLIER, {0, 1, 2, 3}), (Kept.ANY, {0, 1, 2, 3})]
)
def test_a_disk_keeps_of_what_is_not_synced_what_it_is_to(kept, numbers):
    chance = random.Random(0)
    left = [list(selection([1, 2, 3], kept, chance)) for _ in range(100)]
    assert {len(changes) for changes in left} == numbers
    assert all(changes == list(range(1, len(changes) + 1)) for changes in left) == (kept is not Kept.ANY)
