import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.rate_limiter import MAX_HOLD, RateLimiter


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def test_the_learner_waits_for_the_first_steps_and_then_for_the_ratio():
    limiter = RateLimiter(0.5, tolerance=100, min_steps=10)
    limiter.note_steps(9, filled=9)
    assert not limiter.may_update()
    limiter.note_steps(1, filled=10)
    for _ in range(5):
        assert limiter.may_update()
        limiter.note_update()
    assert not limiter.may_update()
    assert limiter.actual == limiter.updates_per_step
    limiter.note_steps(2, filled=12)
    assert limiter.may_update()


def test_actors_are_held_for_as_long_as_the_learner_needs():
    clock = Clock()
    limiter = RateLimiter(0.5, tolerance=100, min_steps=10, clock=clock)
    limiter.note_steps(20, filled=20)
    for _ in range(10):
        clock.now += 0.2
        limiter.note_update()
    assert limiter.hold() == 0.0
    limiter.note_steps(120, filled=140)  # 20 beyond the tolerance: 10 updates of 0.2 s
    assert limiter.hold() == pytest.approx(2.0)
    limiter.note_steps(100_000, filled=100)
    assert limiter.hold() == MAX_HOLD


def test_actors_are_not_held_while_the_first_steps_are_collected():
    limiter = RateLimiter(0.5, tolerance=10, min_steps=1000)
    limiter.note_steps(999, filled=999)
    assert limiter.hold() == 0.0


def test_a_pause_stops_both_sides():
    limiter = RateLimiter(1.0, tolerance=10, min_steps=1)
    limiter.note_steps(5, filled=5)
    limiter.paused = True
    assert not limiter.may_update()
    assert limiter.hold() > 0
    limiter.paused = False
    assert limiter.may_update()
    assert limiter.hold() == 0.0


def test_a_run_resumed_without_its_replay_buffer_fills_it_first():
    limiter = RateLimiter(0.5, tolerance=100, min_steps=50)
    limiter.restore(steps=1000, updates=400, filled=0, fresh_from=1000)
    assert not limiter.may_update()
    limiter.note_steps(49, filled=49)
    assert not limiter.may_update() and limiter.hold() == 0.0
    limiter.note_steps(1, filled=50)
    assert limiter.may_update()


@settings(max_examples=200, deadline=None)
@given(
    ratio=st.floats(1e-4, 20.0),
    tolerance=st.integers(1, 5000),
    min_steps=st.integers(1, 3000),
    chunks=st.lists(st.integers(1, 64), min_size=1, max_size=50),
)
def test_learner_and_actors_never_wait_for_each_other(ratio, tolerance, min_steps, chunks):
    limiter = RateLimiter(ratio, tolerance, min_steps)
    filled = 0
    for steps in chunks:
        filled += steps
        limiter.note_steps(steps, filled)
        assert limiter.hold() == 0.0 or limiter.may_update()
        budget = 50
        while limiter.may_update() and budget:
            limiter.note_update()
            budget -= 1
        assert limiter.updates < ratio * limiter.steps + 1
