"""How far a long command is, where there is no terminal for bars."""

import io

from rich.console import Console

from common.system.progress import LINE_SECONDS, Steps, duration, tell_of_kernels


class Clock:
    """Seconds that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_line_now_and_then_says_how_long_the_rest_takes():
    clock, out = Clock(), io.StringIO()
    with Steps(Console(file=out, emoji=False), clock=clock) as steps:
        # Ten of the earlier run took none of this run's time.
        steps.add("nearest", total=30, done=10)
        steps.advance("nearest")
        assert out.getvalue() == ""
        clock.now += LINE_SECONDS + 70.0
        steps.advance("nearest")
        steps.advance("nearest")
    assert out.getvalue() == "nearest 12 of 30 episodes, about 15 min left\n"


def test_what_is_tracked_is_counted_once_it_was_used():
    clock, out = Clock(), io.StringIO()
    with Steps(Console(file=out), "messages", clock=clock) as steps:
        for thing in steps.track("replay", "abcd", 4):
            clock.now += LINE_SECONDS + 1.0
            assert thing
    assert out.getvalue().splitlines()[0] == "replay 1 of 4 messages, about 93 s left"
    assert out.getvalue().splitlines()[-1] == "replay 4 of 4 messages"


def test_durations_read_well():
    assert [duration(value) for value in (7.4, 119.0, 600.0, 9000.0)] == ["7 s", "119 s", "10 min", "2.5 h"]


def test_the_first_run_is_told_that_kernels_are_prepared(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    out = io.StringIO()
    tell_of_kernels(Console(file=out), "common")
    assert "preparing compiled kernels" in out.getvalue()
    (tmp_path / "module.function-1.py311.1.nbc").touch()
    quiet = io.StringIO()
    tell_of_kernels(Console(file=quiet), "common")
    assert quiet.getvalue() == ""
