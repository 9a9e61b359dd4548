import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus.seen import MAX_RANGES, MAX_STREAMS, SeenSet
from common.errors import CheckpointError

DELIVERIES = st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 1), st.integers(0, 40)), max_size=120)


@given(DELIVERIES, DELIVERIES)
def test_it_is_a_set_and_survives_json(before, after):
    seen, plain = SeenSet(), set()
    for delivery in before:
        assert seen.add(*delivery) == (delivery not in plain)
        plain.add(delivery)
    restored = SeenSet()
    restored.restore(json.loads(json.dumps(seen.state())))
    for delivery in after:
        assert (delivery in restored) == (delivery in plain)
        assert restored.add(*delivery) == (delivery not in plain)
        plain.add(delivery)
    assert len(restored) == len(plain)


@given(st.permutations(range(20)))
def test_a_stream_without_gaps_is_one_range_whatever_the_order(order):
    seen = SeenSet()
    for sequence in order:
        seen.add("a", 2**63 - 1, sequence)
    assert seen.streams() == {("a", 2**63 - 1): [(0, 20)]}


def test_a_gap_left_by_a_restart_costs_one_range():
    seen = SeenSet()
    for sequence in [*range(100), *range(500, 10_000)]:
        seen.add("a", 1, sequence)
    assert seen.streams() == {("a", 1): [(0, 100), (500, 10_000)]}


def test_memory_is_bounded_against_hostile_sequences():
    seen = SeenSet()
    for sequence in range(0, 4 * MAX_RANGES, 2):
        seen.add("a", 1, sequence)
    assert len(seen.streams()["a", 1]) == MAX_RANGES
    for incarnation in range(MAX_STREAMS + 10):
        seen.add("b", incarnation, 0)
    assert len(seen.streams()) == MAX_STREAMS


@pytest.mark.parametrize(
    "state", [{}, {"streams": [["a", 1, 0]]}, {"streams": [["a", 1, 5, 3]]}, {"streams": [[1, 1]]}]
)
def test_a_damaged_state_is_refused(state):
    with pytest.raises(CheckpointError, match="cannot be read"):
        SeenSet().restore(state)
