import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus.keys import host_of
from common.bus.seen import MAX_OPEN_PER_HOST, MAX_RANGES, STREAM_SECONDS, SeenSet
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


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def again(seen):
    """The set as the next process of the learner has it."""
    restored = SeenSet(host_of)
    restored.restore(json.loads(json.dumps(seen.state())))
    return restored


def test_invented_names_make_nothing_be_stored_twice():
    seen = SeenSet(host_of)
    for sequence in range(40):
        assert seen.add("desk-0", 1, sequence)
    for number in range(11_000):
        assert seen.add(f"invented{number % 7}-{number}", number, 0)
    for each in (seen, again(seen)):
        assert all(not each.add("desk-0", 1, sequence) for sequence in range(40))
        assert not any(each.add(f"invented{number % 7}-{number}", number, 0) for number in range(11_000))
        assert each.add("desk-0", 1, 40)
        assert len(each) == 11_041


def test_names_without_end_fill_no_memory_and_are_never_forgotten():
    seen = SeenSet(host_of)
    count = 3 * MAX_OPEN_PER_HOST
    for number in range(count):
        seen.add(f"invented-{number}", number, 0)
        seen.add(f"invented-{number}", number, 1)
    assert len(seen.streams()) == MAX_OPEN_PER_HOST
    assert len(seen) == 2 * count
    assert not any(seen.add(f"invented-{number}", number, sequence) for number in range(count) for sequence in (0, 1))
    assert seen.add("invented-0", 0, 2)


def test_a_host_that_invents_names_closes_no_stream_of_another():
    seen = SeenSet(host_of)
    seen.add("desk-0", 1, 0)
    seen.add("desk-0", 1, 2)
    for number in range(2 * MAX_OPEN_PER_HOST):
        seen.add(f"evil-{number}", number, 0)
    # What is missing from the honest stream is still missing, so that it can come.
    assert seen.add("desk-0", 1, 1)


def test_silent_streams_take_sixteen_bytes_and_go_on_where_they_were():
    clock = Clock()
    seen = SeenSet(host_of, clock)
    for sequence in range(20):
        seen.add("desk-0", 1, sequence)
    seen.add("desk-1", 1, 0)
    seen.add("desk-1", 1, 2)
    clock.now = STREAM_SECONDS + 1
    seen.add("desk-2", 1, 0)
    seen.tidy()
    assert set(seen.streams()) == {("desk-1", 1), ("desk-2", 1)}
    for each in (seen, again(seen)):
        assert ("desk-0", 1, 19) in each
        assert ("desk-0", 1, 20) not in each
        assert not each.add("desk-0", 1, 7)
        assert each.add("desk-0", 1, 20)
        assert each.streams()["desk-0", 1] == [(0, 21)]
        assert len(each) == 24


@pytest.mark.parametrize(
    "state",
    [
        {},
        {"streams": [["a", 1, 0]]},
        {"streams": [["a", 1, 5, 3]]},
        {"streams": [[1, 1]]},
        {"streams": [], "closed": {"key": "00", "ends": ""}},
        {"streams": [], "closed": {"key": "00" * 16, "ends": "AAAA"}},
        {"streams": [], "closed": {"key": "00" * 16}},
    ],
)
def test_a_damaged_state_is_refused(state):
    with pytest.raises(CheckpointError, match="cannot be read"):
        SeenSet().restore(state)
