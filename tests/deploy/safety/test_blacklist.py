import pytest

from deploy.config import SafetyConfig
from deploy.safety.blacklist import Blacklist

DOOR = (5.0, 5.0)


def make() -> Blacklist:
    return Blacklist(SafetyConfig(blacklist_time=100.0), radius=0.5)


def test_ban_ends():
    blacklist = make()
    blacklist.add(DOOR, "blocked", 0.0)
    assert blacklist.banned((5.3, 5.3), 99.0).reason == "blocked"
    assert blacklist.banned((5.6, 5.0), 99.0) is None
    assert blacklist.banned(DOOR, 101.0) is None


def test_every_failure_doubles_the_time_up_to_eight_times():
    blacklist = make()
    now, times = 0.0, []
    for _ in range(6):
        ban = blacklist.add(DOOR, "blocked", now)
        times.append(ban.until - now)
        now = ban.until + 1.0
    assert times == [100.0, 200.0, 400.0, 800.0, 800.0, 800.0]


def test_a_place_is_tried_again_in_between_and_a_failure_then_counts_no_further():
    blacklist = make()
    blacklist.add(DOOR, "blocked", 0.0)
    ban, seconds = blacklist.try_again(10.0)
    assert (ban.position, seconds) == (DOOR, pytest.approx(100.0 / 6.0 - 10.0))
    assert blacklist.banned(DOOR, 10.0) is ban
    assert blacklist.try_again(20.0) == (ban, 0.0)
    assert blacklist.banned(DOOR, 20.0) is None
    again = blacklist.add(DOOR, "blocked", 30.0)
    assert (again.failures, again.began, again.until) == (1, 30.0, 100.0)
    assert blacklist.try_again(50.0) == (again, 0.0)
    assert blacklist.add(DOOR, "blocked", 110.0).failures == 2


def test_a_place_that_failed_twice_is_not_tried_again_before_its_time():
    blacklist = make()
    assert blacklist.try_again(0.0) is None
    blacklist.add(DOOR, "blocked", 0.0)
    blacklist.add(DOOR, "blocked", 101.0)
    other = blacklist.add((8.0, 8.0), "a person", 110.0)
    assert blacklist.hopeful(120.0) == [other]
    assert blacklist.try_again(130.0) == (other, 0.0)
    assert blacklist.try_again(131.0) is None


def test_old_failures_are_forgotten():
    blacklist = make()
    blacklist.add(DOOR, "blocked", 0.0)
    ban = blacklist.add(DOOR, "blocked", 100.0 + 400.0)
    assert (ban.failures, ban.until) == (1, 600.0)


def test_other_places_are_their_own():
    blacklist = make()
    blacklist.add(DOOR, "one", 0.0)
    blacklist.add((8.0, 8.0), "two", 50.0)
    assert [ban.reason for ban in blacklist.active(60.0)] == ["one", "two"]
    assert [ban.reason for ban in blacklist.active(120.0)] == ["two"]
    blacklist.clear()
    assert blacklist.active(60.0) == []
