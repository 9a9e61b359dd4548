"""The first moments of a command, in which Python still imports: signals are heard from the beginning.

Every command of the project begins in the module ``__main__`` of its package, which imports nothing but this one before
signals are heard. It imports its command line then, and a command line imports at its top only what options and help
texts need; what a command works with is imported by its body (``tests/common/system/test_entry.py``).
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from common.system.hangup import hangup_signals, leave_terminal


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End with one line and status 130 or 143 on SIGINT or SIGTERM, unless what runs within the `with` takes them.

    A terminal that is closed (SIGHUP) ends what runs in it like SIGTERM, with status 129.

    Standard streams that were closed (``2>&-``, some service managers) lead nowhere: otherwise the first file that is
    opened takes the number of one, and what is meant for a terminal goes into it.

    Matrix products of numpy take one thread in a command, and in what it starts, unless its user says otherwise.

    Usage::

        with ended_by_signals():
            from learner.cli import app

            app()
    """
    _open_closed_streams()
    for number in (signal.SIGTERM, *hangup_signals()):
        signal.signal(number, _terminate)
    # Read when numpy is loaded. Products here are small (`common.system.blas`); the learner's are torch's.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        yield
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        raise SystemExit(128 + signal.SIGINT) from None


def _open_closed_streams() -> None:
    """Let the standard streams that are closed lead nowhere, for children too."""
    for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _terminate(number: int, frame: FrameType | None) -> None:
    """Unwind, so that child processes and files are cleared away; a second signal ends the process at once."""
    del frame
    signal.signal(number, signal.SIG_DFL)
    if number != signal.SIGTERM:
        leave_terminal()
    # Not through sys.stderr, which the signal may have found in the midst of a line.
    os.write(2, b"terminated\n")
    raise SystemExit(128 + number)
