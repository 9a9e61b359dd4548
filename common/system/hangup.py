"""What becomes of a process whose terminal goes: a window that is closed, a connection to a robot that breaks off."""

from __future__ import annotations

import errno
import os
import signal


def hangup_signals() -> tuple[signal.Signals, ...]:
    """Return SIGHUP; nothing where it is ignored, as under nohup, or is no signal of the system."""
    number = getattr(signal, "SIGHUP", None)
    return () if number is None or signal.getsignal(number) == signal.SIG_IGN else (number,)


def leave_terminal() -> None:
    """Let the output go nowhere where its terminal is gone: each further line would be an error. Files stay."""
    import termios

    for descriptor in (0, 1, 2):
        try:
            termios.tcgetattr(descriptor)
        except termios.error as error:
            if error.args[0] == errno.EIO:
                nowhere = os.open(os.devnull, os.O_RDWR)
                os.dup2(nowhere, descriptor)
                os.close(nowhere)
