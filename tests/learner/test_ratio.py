import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.ratio import MAX_HOLD, RatioKeeper


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def test_the_learner_waits_for_the_first_steps_and_then_for_the_ratio():
    keeper = RatioKeeper(0.5, tolerance=100, min_steps=10)
    keeper.note_steps(9, filled=9)
    assert not keeper.may_update()
    keeper.note_steps(1, filled=10)
    for _ in range(5):
        assert keeper.may_update()
        keeper.note_update()
    assert not keeper.may_update()
    assert keeper.actual == keeper.updates_per_step
    keeper.note_steps(2, filled=12)
    assert keeper.may_update()


def test_actors_are_held_for_as_long_as_the_learner_needs():
    clock = Clock()
    keeper = RatioKeeper(0.5, tolerance=100, min_steps=10, clock=clock)
    keeper.note_steps(20, filled=20)
    for _ in range(10):
        clock.now += 0.2
        keeper.note_update()
    assert keeper.hold() == 0.0
    keeper.note_steps(120, filled=140)  # 20 beyond the tolerance: 10 updates of 0.2 s
    assert keeper.hold() == pytest.approx(2.0)
    keeper.note_steps(100_000, filled=100)
    assert keeper.hold() == MAX_HOLD


def test_actors_are_not_held_while_the_first_steps_are_collected():
    keeper = RatioKeeper(0.5, tolerance=10, min_steps=1000)
    keeper.note_steps(999, filled=999)
    assert keeper.hold() == 0.0


def test_a_pause_stops_both_sides():
    keeper = RatioKeeper(1.0, tolerance=10, min_steps=1)
    keeper.note_steps(5, filled=5)
    keeper.paused = True
    assert not keeper.may_update()
    assert keeper.hold() > 0
    keeper.paused = False
    assert keeper.may_update()
    assert keeper.hold() == 0.0


def test_a_run_resumed_without_its_replay_buffer_fills_it_first():
    keeper = RatioKeeper(0.5, tolerance=100, min_steps=50)
    keeper.restore(steps=1000, updates=400, filled=0, fresh_from=1000)
    assert not keeper.may_update()
    keeper.note_steps(49, filled=49)
    assert not keeper.may_update() and keeper.hold() == 0.0
    keeper.note_steps(1, filled=50)
    assert keeper.may_update()


@settings(max_examples=200, deadline=None)
@given(
    ratio=st.floats(1e-4, 20.0),
    tolerance=st.integers(1, 5000),
    min_steps=st.integers(1, 3000),
    chunks=st.lists(st.integers(1, 64), min_size=1, max_size=50),
)
def test_learner_and_actors_never_wait_for_each_other(ratio, tolerance, min_steps, chunks):
    keeper = RatioKeeper(ratio, tolerance, min_steps)
    filled = 0
    for steps in chunks:
        filled += steps
        keeper.note_steps(steps, filled)
        assert keeper.hold() == 0.0 or keeper.may_update()
        budget = 50
        while keeper.may_update() and budget:
            keeper.note_update()
            budget -= 1
        assert keeper.updates < ratio * keeper.steps + 1
