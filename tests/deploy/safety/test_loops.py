from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from deploy.safety.loops import LoopDetector

A, B, C = (0.0, 0.0), (4.0, 0.0), (4.0, 4.0)


def decide(detector: LoopDetector, waypoints, area=lambda step: 100.0):
    loops = [detector.decide(waypoint, area(step)) for step, waypoint in enumerate(waypoints)]
    return [loop for loop in loops if loop]


def test_swinging_between_two_waypoints_is_a_loop():
    (loop, *_) = decide(LoopDetector(), [A, B] * 4)
    assert set(loop.waypoints) == {A, B}
    assert loop.repeats == 3


def test_circle_is_named_in_its_order():
    (loop, *_) = decide(LoopDetector(), [A, B, C] * 4)
    assert loop.waypoints in [(A, B, C), (B, C, A), (C, A, B)]


def test_circle_with_news_is_none():
    assert not decide(LoopDetector(), [A, B, C] * 10, area=lambda step: 100.0 + step)


def test_same_choice_again_is_no_move():
    assert not decide(LoopDetector(), [A] * 50 + [B] * 50 + [A] * 50)


def test_way_there_and_back_is_no_loop():
    way = [(float(i), 0.0) for i in range(20)]
    assert not decide(LoopDetector(), way + way[::-1])


def test_reset_forgets():
    detector = LoopDetector()
    decide(detector, [A, B] * 2)
    detector.reset()
    assert not decide(detector, [A, B] * 2)


@given(st.lists(st.sampled_from([A, B, C]), min_size=40, max_size=60))
def test_long_wandering_over_three_waypoints_is_always_noticed(waypoints):
    moves = sum(a != b for a, b in pairwise(waypoints))
    loops = decide(LoopDetector(), waypoints)
    # Six moves are possible; each may be made twice.
    assert bool(loops) or moves <= 12
    for loop in loops:
        assert 2 <= len(set(loop.waypoints)) <= 3
