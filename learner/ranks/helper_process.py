"""Rank 0's end of a helper: starts the process, speaks to it, and never waits long for it."""

from __future__ import annotations

import json
import logging
import os
import select
import subprocess
import threading
import time

import torch

from common.config import RunConfig
from common.config.names import module_names
from common.system.closing import Closing
from common.system.runtime import process_environment, python_module
from learner.algorithm.base import RanksError
from learner.child_log import pass_on_log
from learner.ranks.messages import frame

helper_log = logging.getLogger("ranks")

SEND_SECONDS = 60.0
"""For which a helper may leave a message unread; one that is silent for longer counts as lost."""
STOP_SECONDS = 4.0


class HelperProcess(Closing):
    """A helper, from its start to its end.

    Args:
        number: of the helper, 1 upwards.
        config: of the run.
        device: where it computes.
        threads: of its numerical libraries.
    """

    def __init__(self, number: int, config: RunConfig, device: torch.device, threads: int) -> None:
        self.number = number
        self._ready = False
        self._process = subprocess.Popen(
            python_module("learner.ranks.helper"),
            env=process_environment(threads=threads),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C reaches us alone, and we stop it in order
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        assert self._process.stderr is not None
        self._input, self._output = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._input, False)
        errors = open(self._process.stderr.fileno(), encoding="utf-8", errors="replace", closefd=False)  # noqa: SIM115
        self._reader = threading.Thread(
            target=pass_on_log, args=(errors, helper_log, f"rank {number}"), name=f"log of rank {number}", daemon=True
        )
        self._reader.start()
        level = logging.getLevelName(logging.getLogger().getEffectiveLevel()).lower()
        begin = {"config": config.model_dump_json(), "allowed": json.dumps(module_names(config))}
        self.send(frame("begin", **begin, device=str(device), threads=threads, log_level=level))

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    @property
    def ready(self) -> bool:
        """Whether it has made its networks and can join."""
        if not self._ready and select.select([self._output], [], [], 0.0)[0]:
            self._ready = bool(os.read(self._output, 64))
        return self._ready

    def send(self, message: bytes) -> None:
        """Write a message.

        Raises:
            RanksError: the helper is gone, or does not read.
        """
        left, end = memoryview(message), time.monotonic() + SEND_SECONDS
        try:
            while left:
                if not select.select([], [self._input], [], max(end - time.monotonic(), 0.0))[1]:
                    self.kill()
                    raise RanksError(f"learner rank {self.number} does not read what it is sent")
                left = left[os.write(self._input, left) :]
        except OSError as error:
            raise RanksError(f"learner rank {self.number} has ended") from error

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End the process: kindly, and after a few seconds outright. Safe to call twice."""
        assert self._process.stdin is not None and self._process.stdout is not None
        assert self._process.stderr is not None
        self._process.stdin.close()  # the helper ends with its messages
        try:
            self._process.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
        self._reader.join(1.0)
        self._process.stdout.close()
        self._process.stderr.close()
