"""A machine that loses its power at any moment, on a disk that keeps nothing but what was synced."""

import pytest

from tests.learner.power.failures import CannotRecordError, fail, record
from tests.learner.power.victim import EPISODES


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    try:
        return record(tmp_path_factory.mktemp("power"))
    except CannotRecordError as error:
        pytest.skip(str(error))


def test_a_power_failure_costs_nothing_that_was_acknowledged(recording, tmp_path):
    assert sum(operation.first.startswith(b"stored") for operation in recording[2]) == 3 * EPISODES
    assert fail(recording, 8, seed=0, folder=tmp_path) == [set()] * 8


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_200_power_failures_cost_nothing_that_was_acknowledged(recording, tmp_path):
    assert fail(recording, 200, seed=1, folder=tmp_path) == [set()] * 200


def test_acknowledging_from_memory_costs_some(recording, tmp_path):
    """So the failures of these tests do take what is not synced."""
    lost = fail(recording, 5, seed=0, folder=tmp_path, word="taken")
    assert 0 < sum(map(len, lost)) < 5 * 3 * EPISODES
