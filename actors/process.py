"""One actor as a process.

Started by the supervisor as ``python -m actors.process OPTIONS``, the options being JSON (`ActorOptions`). Exit codes:
0 told to stop, 1 crashed (worth another try), 3 something that a user has to mend.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from contextlib import nullcontext

from actors.options import ActorOptions
from actors.parent import follow_parent
from common.errors import HDError
from common.system.logs import setup_logging
from common.system.signals import on_signals

log = logging.getLogger(__name__)

EXIT_CRASH = 1
EXIT_UNUSABLE = 3


def main(arguments: list[str] | None = None) -> int:
    """Run one actor until it is told to stop; return its exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    options = ActorOptions.model_validate_json(given[0])
    setup_logging(options.log_level)
    stop = threading.Event()
    with on_signals(lambda _: stop.set(), signal.SIGINT, signal.SIGTERM):
        return _run(options, stop)


def _run(options: ActorOptions, stop: threading.Event) -> int:
    if options.parent:
        follow_parent(options.parent, stop)
    # Imported late: signals and the parent are looked after while numba and the simulator load.
    from actors.figures import serve_figures
    from actors.worker import Worker

    worker = Worker(options, stop)
    try:
        with nullcontext() if options.metrics is None else serve_figures(options.metrics, worker):
            worker.run()
    except HDError as error:
        log.error("%s", error)
        return EXIT_CRASH if worker.acted else EXIT_UNUSABLE
    return 0


if __name__ == "__main__":
    code = main()
    # Threads of Zenoh or PyBullet must not keep a finished actor alive.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
