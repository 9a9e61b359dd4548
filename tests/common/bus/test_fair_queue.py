"""Sources of a queue take turns, and the largest one makes room."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from common.bus.fair_queue import FairQueue


def taken(queue, count):
    return [queue.get() for _ in range(count)]


def test_sources_take_turns_and_each_keeps_its_order():
    queue = FairQueue(10, 100)
    for source, item in ("a", 1), ("a", 2), ("a", 3), ("b", 4), ("c", 5), ("b", 6):
        assert queue.put(source, item, 1) == []
    assert taken(queue, 6) == [1, 4, 5, 2, 6, 3]


def test_the_newest_items_of_the_largest_source_make_room():
    queue = FairQueue(4, 100)
    assert [queue.put("a", item, 1) for item in range(5)] == [[], [], [], [], [4]]
    assert queue.put("b", "b0", 1) == [3]
    assert queue.put("b", "b1", 1) == [2]
    assert queue.put("b", "b2", 1) == ["b2"]
    assert taken(queue, 4) == [0, "b0", 1, "b1"]


def test_bytes_fill_a_queue_as_items_do():
    queue = FairQueue(100, 1000)
    assert queue.put("big", "x", 600) == []
    assert queue.put("big", "y", 600) == ["y"]
    assert queue.put("too big", "z", 1001) == ["z"]
    assert queue.put("small", "s", 300) == []
    assert queue.put("small", "t", 200) == ["x"]
    assert taken(queue, 2) == ["s", "t"]


def test_a_closed_queue_gives_back_what_waits_and_lets_nobody_wait():
    queue = FairQueue(4, 100)
    got = []
    waits = threading.Thread(target=lambda: got.append(queue.get()))
    waits.start()
    assert queue.close() == []
    waits.join(10)
    assert got == [None] and queue.put("a", 1, 1) == [1] and queue.get() is None
    full = FairQueue(4, 100)
    full.put("a", 1, 1)
    full.put("b", 2, 1)
    assert full.close() == [1, 2] and full.get() is None


@given(st.lists(st.one_of(st.none(), st.tuples(st.sampled_from("abcd"), st.integers(0, 60))), max_size=80))
def test_nothing_vanishes_and_the_bounds_hold(actions):
    """Every item is taken or refused exactly once; nobody below an equal share is refused."""
    queue, waiting, sizes = FairQueue(8, 100), {}, {}
    for number, action in enumerate(actions):
        if action is None:
            if waiting:
                waiting.pop(queue.get())
            continue
        source, size = action
        sizes[number] = size
        refused = queue.put(source, number, size)
        waiting[number] = source
        for item in refused:
            waiting.pop(item)
        share = max(1 / 8, size / 100)
        if number in refused:
            own = sum(max(1 / 8, sizes[item] / 100) for item, of in waiting.items() if of == source)
            assert own + share > 1 / len({*waiting.values(), source}) - 1e-9
        assert len(waiting) <= 8 and sum(sizes[item] for item in waiting) <= 100
    assert sorted(queue.close()) == sorted(waiting)
