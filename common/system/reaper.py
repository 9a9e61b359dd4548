"""Child processes that end with their parent, whatever they are doing and however that ends.

Children look after their parent themselves, and stop in order when it is gone. One that is frozen, or deep in a call
that lets no other thread run, cannot: a small process of its own waits for the parent's end, gives the children a
moment, and kills what is left of them.

Used as ``python common/system/reaper.py SECONDS``, with a pipe as input whose other end the parent alone holds; the
process is the leader of the process group that its wards are in.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

GRACE_SECONDS = 2.0
"""What children get to stop in order when their parent was killed."""


class Reaper:
    """The parent's end; the parent starts its children with ``process_group=reaper.group()``.

    Usage::

        with Reaper() as reaper:
            child = subprocess.Popen(command, process_group=reaper.group())
            ...

    Args:
        grace: seconds from the parent's end until its children are killed.
    """

    def __init__(self, grace: float = GRACE_SECONDS) -> None:
        self._grace = grace
        self._process: subprocess.Popen[bytes] | None = None

    def group(self) -> int:
        """Return the process group of the children, making it first if need be."""
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._process = subprocess.Popen(
                # Without site packages and the environment: it starts in a few milliseconds.
                [sys.executable, "-I", "-S", str(Path(__file__).resolve()), str(self._grace)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                process_group=0,
            )
        return self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the reaper, not the children: the parent has seen to those. Safe to call twice."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        if process.stdin is not None:
            process.stdin.close()


def main(grace: float) -> None:
    """Wait until the parent is gone, then until the children had their time, and kill the group."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    while os.read(0, 1):
        pass
    time.sleep(grace)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main(float(sys.argv[1]))
