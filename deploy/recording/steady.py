"""The time of a recording without the steps of its recorder's clock, so that it can be played."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

from deploy.recording.storage import Recorded

log = logging.getLogger(__name__)

BACK: Final = 1_000_000_000
"""Recorders write messages nearly in the order of their arrival: a clock steps back by more than this, nanoseconds."""
# After a step forward by more, nanoseconds, the clock was set, or nothing was recorded for that long.
_FORWARD: Final = 600_000_000_000
# What is put in the place of a step.
_BETWEEN: Final = 100_000_000


def without_clock_steps(messages: Iterable[Recorded], *, say: bool = True) -> Iterator[Recorded]:
    """Yield messages with times that go on where the recorder's clock was set back, or far forward.

    A robot without a clock of its own begins in 1970, or where it was switched off, until the network tells it the
    time: played as recorded that would take half a century, and after a step back nothing would be due for as long.

    Args:
        messages: in the order of the file.
        say: whether to log each step as a warning.
    """
    shift, last = 0, None
    for recorded in messages:
        if last is not None and not -BACK <= recorded.time - last <= _FORWARD:
            step = (recorded.time - last) * 1e-9
            if say:
                log.warning("the clock of the recording steps by %+.1f s, which is left out", step)
            shift += last + _BETWEEN - recorded.time
        last = recorded.time
        yield replace(recorded, time=recorded.time + shift) if shift else recorded
