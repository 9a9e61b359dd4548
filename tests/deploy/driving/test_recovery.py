from deploy.driving.recovery import ProgressWatch, Remedy, Schedule

SCHEDULE = Schedule(back_off=2.0, turn=4.0, blocked=6.0, again=8.0)


def remedies(watch: ProgressWatch, remaining, seconds: float, turning: bool = False) -> list[Remedy]:
    return [watch.update(remaining(0.5 * step), 0.5, turning=turning) for step in range(round(seconds / 0.5))]


def test_progress_needs_no_remedy():
    watch = ProgressWatch(SCHEDULE)
    assert set(remedies(watch, lambda time: 30.0 - time, 20.0)) == {Remedy.NONE}
    assert not watch.blocked


def test_standstill_brings_one_remedy_after_the_other():
    watch = ProgressWatch(SCHEDULE)
    tried = remedies(watch, lambda time: 5.0, 8.0)
    assert list(dict.fromkeys(tried)) == [Remedy.NONE, Remedy.BACK_OFF, Remedy.TURN]
    assert watch.blocked


def test_turning_on_the_spot_is_given_more_time():
    assert set(remedies(ProgressWatch(SCHEDULE), lambda time: 5.0, 5.0, turning=True)) == {Remedy.NONE}


def test_progress_ends_the_blockade():
    watch = ProgressWatch(SCHEDULE)
    remedies(watch, lambda time: 5.0, 7.0)
    assert watch.blocked
    watch.update(4.5, 0.5, turning=False)
    assert not watch.blocked


def test_remedies_come_again():
    watch = ProgressWatch(SCHEDULE)
    tried = remedies(watch, lambda time: 5.0, 20.0)
    assert tried.count(Remedy.BACK_OFF) >= 8
    assert watch.blocked


def test_a_robot_that_rolls_on_before_it_turns_back_does_not_stand_still():
    watch = ProgressWatch()
    remedies(watch, lambda time: 12.0 - time, 10.0)
    # The way leads back now; 1 m/s at 0.3 m/s2 is 1.7 m farther on. That it has to turn shows one update later.
    watch.shift(20.0)
    assert watch.update(21.9, 0.5, turning=False) is Remedy.NONE
    rolling = remedies(watch, lambda time: 21.9 + time - 0.15 * time**2, 3.5, turning=True)
    leading_back = remedies(watch, lambda time: 23.6 - 0.15 * time**2, 6.0)
    assert {*rolling, *leading_back} == {Remedy.NONE}
