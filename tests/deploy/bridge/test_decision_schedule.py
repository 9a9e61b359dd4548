"""When a planner is asked again, by the clock and by what has changed."""

from common.geometry import Pose
from deploy.bridge.decision_schedule import DecisionSchedule

HERE = Pose(1.0, 2.0, 0.0)


def test_the_rate_holds_back_until_somebody_is_in_a_hurry():
    schedule = DecisionSchedule(rate=2.0)
    assert schedule.may_ask(0.0)
    schedule.note_asked(10.0, HERE, version=3, known_cells=100)
    assert [schedule.may_ask(now) for now in (10.0, 10.4, 10.5)] == [False, False, True]
    schedule.hurry(10.1)
    assert schedule.may_ask(10.1)
    assert not schedule.is_new(3)
    schedule.wait(10.2)
    assert not schedule.may_ask(10.6)
    schedule.restart(10.6)
    assert schedule.may_ask(10.6)
    assert schedule.is_new(3)


def test_a_robot_that_stands_and_learns_nothing_has_no_news():
    schedule = DecisionSchedule(rate=2.0)
    assert schedule.has_news(HERE, 100)
    assert not schedule.stands(HERE)
    schedule.note_asked(0.0, HERE, version=3, known_cells=100)
    assert not schedule.has_news(Pose(1.01, 2.0, 3.0), 100)
    assert schedule.stands(Pose(1.01, 2.0, 3.0))
    assert schedule.has_news(Pose(1.03, 2.0, 0.0), 100)
    assert schedule.has_news(HERE, 101)
    assert schedule.is_new(4)
