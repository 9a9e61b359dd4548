import threading
import time

import pytest

from learner.checkpointing import CheckpointSchedule


def test_the_clock_alone_makes_no_checkpoint_of_what_is_covered():
    schedule = CheckpointSchedule(every_seconds=0.0)
    schedule.restart()
    assert schedule.is_due(updates=5, steps=80)
    schedule.note_written(updates=5, steps=80)
    assert not schedule.is_due(updates=5, steps=80)
    assert schedule.is_due(updates=5, steps=96)


def test_a_command_makes_it_due_before_its_time():
    schedule = CheckpointSchedule(every_seconds=3600.0)
    schedule.restart()
    assert 3590.0 < schedule.seconds_left <= 3600.0
    assert not schedule.is_due(updates=5, steps=80)
    schedule.request()
    assert schedule.is_due(updates=5, steps=80)
    schedule.note_written(updates=5, steps=80)
    assert not schedule.is_due(updates=5, steps=80)


def test_who_asks_waits_until_it_is_done():
    schedule = CheckpointSchedule(every_seconds=3600.0)
    assert not schedule.request_and_wait(timeout=0.01)
    threading.Timer(0.1, schedule.note_done).start()
    assert schedule.request_and_wait(timeout=20.0)


@pytest.mark.parametrize("covered", [True, False])
def test_nobody_waits_for_a_checkpoint_that_a_run_at_its_end_makes_no_more(covered):
    schedule = CheckpointSchedule(every_seconds=3600.0)
    threading.Timer(0.1, schedule.end, [covered]).start()
    began = time.monotonic()
    assert schedule.request_and_wait(timeout=60.0) is covered
    assert schedule.request_and_wait(timeout=60.0) is covered
    assert time.monotonic() - began < 30.0
