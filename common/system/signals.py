"""Signals that end a process: what they do while something runs, and what they did before is put back."""

from __future__ import annotations

import ctypes
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from common.system.hangup import hangup_signals, leave_terminal

_PR_SET_PDEATHSIG: Final = 1


@contextmanager
def on_signals(handle: Callable[[signal.Signals], None], *numbers: signal.Signals) -> Iterator[None]:
    """Call `handle` with each of these signals within the `with`; for the main thread alone.

    SIGTERM stands for SIGHUP too: what runs in a terminal that is closed ends in order, and its output goes nowhere.

    Args:
        handle: may raise, as KeyboardInterrupt does, out of whatever the main thread is at.
        numbers: the signals.
    """

    def handler(number: int, frame: FrameType | None) -> None:
        del frame
        if number in hangups:
            leave_terminal()
        handle(signal.Signals(number))

    hangups = hangup_signals() if signal.SIGTERM in numbers else ()
    before = {number: signal.signal(number, handler) for number in (*numbers, *hangups)}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def stopping_signals(stop: Callable[[], object], stopping: Callable[[], bool]) -> Iterator[None]:
    """Stop in order on SIGINT, SIGTERM and SIGHUP within the `with`; SIGINT while stopping is a KeyboardInterrupt.

    Usage::

        with stopping_signals(event.set, event.is_set):
            run_until(event)

    Args:
        stop: begins to stop and returns at once.
        stopping: whether that has begun, by a signal or otherwise.
    """

    def handle(number: signal.Signals) -> None:
        if number == signal.SIGINT and stopping():
            raise KeyboardInterrupt
        stop()

    with on_signals(handle, signal.SIGINT, signal.SIGTERM):
        yield


def ignore_signals(*numbers: signal.Signals) -> None:
    """Ignore these signals from now on: a process that ends by other means does so."""
    for number in numbers:
        signal.signal(number, signal.SIG_IGN)


def terminate_with_parent() -> None:
    """Ask Linux for a SIGTERM at the parent's death; elsewhere nothing happens. The request survives `os.execv`."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
