import logging
import time

import pytest

from common.system.threads import Complaints, Ticker, guarded
from tests.common.bus.processes import eventually


def test_a_ticker_goes_on_after_an_error_and_says_what_it_was(caplog):
    times = []

    def act():
        times.append(time.monotonic())
        if len(times) < 3:
            raise AttributeError("'LearnerStats' object has no attribute 'buffered'")

    with Ticker("statistics", 0.01, act):
        assert eventually(lambda: len(times) > 4)
    said = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert len(said) == 1
    assert "statistics failed and continues: AttributeError: 'LearnerStats' object has no attribute" in said[0].message
    assert said[0].exc_info is not None
    ended = len(times)
    time.sleep(0.05)
    assert len(times) == ended


def test_the_same_error_again_and_again_floods_no_log(caplog):
    complaints = Complaints("answering")
    for number in range(1000):
        with complaints:
            raise ValueError("always the same" if number != 500 else "another")
    assert complaints.count == 1000
    assert len(caplog.records) == 3
    assert "499 errors more" in caplog.text


def test_what_is_expected_while_closing_is_no_news(caplog):
    with Complaints("delivery", lambda: True):
        raise OSError("the session is closed")
    assert not caplog.records


def test_an_interrupt_passes():
    with pytest.raises(KeyboardInterrupt), Complaints("answering"):
        raise KeyboardInterrupt


def test_a_guarded_callback_hands_its_arguments_on():
    came = []
    call = guarded("hearing", lambda a, *, b: came.append((a, b)))
    call(1, b=2)
    assert came == [(1, 2)]
