"""Real processes and real ports for the tests of the bus."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from common.config import BusConfig

ROOT = Path(__file__).parents[3]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def loopback(**settings) -> BusConfig:
    return BusConfig(listen=f"tcp/127.0.0.1:{free_port()}", **settings)


@contextlib.contextmanager
def python(code: str, *arguments: str):
    """Run code in a Python process of its own; it is killed at the end if it still runs."""
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGCONT)
            process.kill()
        process.wait(10)
        process.stdin.close()
        process.stdout.close()


def eventually(condition, timeout: float = 15.0) -> bool:
    """Wait until a condition holds."""
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True
