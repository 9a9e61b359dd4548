"""A process that ends with the one that started it."""

from __future__ import annotations

import logging
import os
import threading

from common.system.signals import terminate_with_parent

log = logging.getLogger(__name__)

_POLL_SECONDS = 0.5
# A stop in good order takes no longer.
_STOP_SECONDS = 3.0


def follow_parent(parent: int, stop: threading.Event) -> None:
    """End this process when the one that started it is gone.

    Linux is asked for a SIGTERM; a thread looks after the parent's number everywhere, sets `stop`, and ends the process
    outright, as after a crash, when a stop in good order takes longer than three seconds.

    Args:
        parent: number of the process to follow.
        stop: is set then.
    """
    terminate_with_parent()

    def watch() -> None:
        while os.getppid() == parent:
            if stop.wait(_POLL_SECONDS):
                return
        log.warning("process %d, which started this one, is gone: stopping", parent)
        stop.set()
        threading.Event().wait(_STOP_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()
