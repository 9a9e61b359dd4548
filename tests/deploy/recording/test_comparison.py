import math

import pytest

from deploy.recording.comparison import Decision, changes, compare


def at(time, *waypoint):
    return Decision(time, waypoint or None)


def test_only_changes_count():
    said = [at(1, 0.0, 0.0), at(2, 0.0, 0.0), at(3, 5.0, 0.0), at(4), at(5, 5.0, 0.0)]
    assert [one.time for one in changes(said)] == [1, 3, 5]


def test_the_same_decisions_agree_although_they_come_at_other_moments():
    recorded = [at(10.0, 1.0, 0.0), at(12.0, 2.0, 0.0), at(14.0, 3.0, 0.0)]
    replayed = [at(10.3, 1.0, 0.0), at(11.8, 2.0, 0.0), at(14.2, 3.0, 0.0)]
    result = compare(recorded, replayed, 10.0, 0.5)
    assert result.agreement == 1.0
    assert result.first is None
    assert result.distances() == [0.0, 0.0, 0.0]


def test_the_first_difference_is_told():
    recorded = [at(10.0, 1.0, 0.0), at(12.0, 2.0, 0.0), at(14.0, 3.0, 0.0), at(20.0, 4.0, 0.0)]
    replayed = [at(10.0, 1.0, 0.0), at(12.0, 2.0, 3.0), at(14.0, 3.0, 0.2), at(16.0)]
    result = compare(recorded, replayed, 10.0, 0.5)
    assert result.agreement == 0.5
    # The nearest of those in force around that time, here the one before.
    assert (result.first.time, result.first.recorded, result.first.replayed) == (2.0, (2.0, 0.0), (1.0, 0.0))
    assert result.distances() == pytest.approx([0.0, 0.2, 1.0])
    assert math.isinf(result.differences[-1].distance)
    assert result.differences[-1].replayed is None


def test_nothing_recorded_agrees():
    assert compare([], [at(1.0, 1.0, 1.0)], 0.0, 0.5).agreement == 1.0
    assert compare([at(1.0, 1.0, 1.0)], [], 0.0, 0.5).agreement == 0.0
