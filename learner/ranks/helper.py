"""A learner process that only computes: it makes the updates that rank 0 shares with it, and ends with rank 0.

Started by `learner.ranks.helper_process` as ``python -m learner.ranks.helper``. It reads messages from standard input
and writes one line to standard output once it is ready; its log goes to standard error.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
from pathlib import Path
from typing import Any, BinaryIO

import torch

from common.config.names import config_from_message
from common.system.logs import setup_logging
from common.system.runtime import limit_threads
from common.system.signals import ignore_signals
from learner.algorithm.base import RanksError
from learner.algorithm.factory import make_learner
from learner.algorithm.policy_learner import PolicyLearner
from learner.ranks.group import Group
from learner.ranks.messages import read_batch, read_frame, read_state
from learner.warmup import warm_up

logger = logging.getLogger(__name__)

READY = b"ready\n"


class Helper:
    """Carries out what rank 0 says.

    Args:
        learner: of the run's configuration.
    """

    def __init__(self, learner: PolicyLearner) -> None:
        self._learner = learner
        self._group: Group | None = None

    def carry_out(self, message: dict[str, Any]) -> None:
        """Join a group, take over a state, or make an update; a lost group is left, and rank 0 makes another."""
        try:
            if message["kind"] == "join":
                self._leave()
                self._group = Group(
                    message["rank"], message["size"], Path(message["meeting_place"]), self._learner.device
                )
                self._learner.ranks = self._group
            elif message["kind"] == "state":
                self._learner.restore(*read_state(message))
            elif self._group is not None:
                self._learner.step(read_batch(message["batch"]))
        except RanksError as error:
            logger.warning("%s", error)
            self._leave()

    def _leave(self) -> None:
        group, self._group = self._group, None
        self._learner.ranks = None
        if group is not None:
            group.close()


def main() -> None:
    """Serve rank 0 until it closes standard input."""
    messages: BinaryIO = sys.stdin.buffer
    # What libraries print must not look like an answer.
    answers = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    ignore_signals(signal.SIGINT, signal.SIGTERM)  # rank 0 hears them and ends in order
    begin = read_frame(messages)
    if begin is None:
        return
    setup_logging(begin["log_level"])
    limit_threads(begin["threads"])
    # It comes from rank 0, whose user has named all of its modules.
    config = config_from_message(begin["config"], json.loads(begin["allowed"]), "name it at the learner")
    device = torch.device(begin["device"])
    warm_up(config, device)
    helper = Helper(make_learner(config, device))
    os.write(answers, READY)
    while (message := read_frame(messages)) is not None:
        helper.carry_out(message)


if __name__ == "__main__":
    main()
