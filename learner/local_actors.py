"""Actors that a learner starts on its own machine: separate processes of the command `hd-actor`."""

from __future__ import annotations

import logging
import os
import subprocess
import threading
from collections.abc import Sequence

from common.config import BusConfig
from common.errors import ConfigError
from common.system.closing import Closing
from common.system.runtime import process_environment, python_module
from learner.child_log import pass_on_log

logger = logging.getLogger(__name__)
actor_log = logging.getLogger("actors")

LOCAL = "local"
"""What the names of local actors begin with: the host that they count as."""
STOP_SECONDS = 4.0


def local_endpoint(listen: str) -> str:
    """Endpoint under which this machine reaches a learner that listens on ``listen``."""
    for anywhere in ("/0.0.0.0:", "/[::]:"):
        listen = listen.replace(anywhere, "/127.0.0.1:")
    return listen


class LocalActors(Closing):
    """One `hd-actor` command with several actors; it ends with this process, whatever happens to that.

    Its output appears in our log, line by line. When it ends by itself, the log says so and training continues.

    Args:
        bus: of the run.
        run: name of the run.
        number: of actors.
        prefix: of their names.
        options: further options of `hd-actor`.

    Raises:
        ConfigError: when the bus uses certificates, since each actor needs its own.
    """

    def __init__(self, bus: BusConfig, run: str, number: int, prefix: str = LOCAL, options: Sequence[str] = ()) -> None:
        if bus.tls_ca is not None:
            raise ConfigError(
                "local actors (--actors) have no certificates: with TLS, start them with `hd-actor` and their "
                "certificate"
            )
        command = python_module("actors", "--num", str(number), "--connect", local_endpoint(bus.listen))
        command += ["--run", run, "--name", prefix, *options]
        self._number = number
        self._stopping = False
        self._process = subprocess.Popen(
            python_module("common.system.tethered", str(os.getpid()), *command),
            env=process_environment(threads=1),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C reaches us alone, and we stop it in order
        )
        self._reader = threading.Thread(target=self._read, name="local actors", daemon=True)
        self._reader.start()
        logger.info("started %d local actors (process %d)", number, self._process.pid)

    @property
    def alive(self) -> bool:
        """Whether the command still runs."""
        return self._process.poll() is None

    def close(self) -> None:
        """Stop the actors: kindly, and after a few seconds outright. Safe to call twice."""
        self._stopping = True
        if self.alive:
            self._process.terminate()
            try:
                self._process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                logger.warning("the local actors did not stop within %.0f s and are killed", STOP_SECONDS)
                self._process.kill()
                self._process.wait()
        self._reader.join(1.0)

    def _read(self) -> None:
        assert self._process.stdout is not None
        pass_on_log(self._process.stdout, actor_log, "the local actors")
        code = self._process.wait()
        if not self._stopping:
            level = logging.ERROR if code else logging.INFO
            logger.log(level, "the local actors have ended with exit code %d; training waits for others", code)
