"""Finished rounds of evaluation: the best policy is chosen by them, and a run waits at its end for the last one."""

from __future__ import annotations

import time

from learner.curve_recorder import CurveRecorder
from learner.ingest import Ingest
from learner.run.best import BestPolicy
from learner.run.evaluation import Round

_EVALUATOR_SECONDS = 60.0


class Evaluations:
    """Takes finished rounds, each once, however often the disk refuses what they lead to.

    Args:
        best: keeps the best policy.
    """

    def __init__(self, best: BestPolicy) -> None:
        self._best = best
        self._waiting: list[Round] = []
        self._newest = -1

    def collect(self, ingest: Ingest) -> None:
        """Take over the rounds that were completed since the last call."""
        self._waiting += ingest.finished_rounds()

    def consider(self, recorder: CurveRecorder) -> None:
        """Let each round that waits decide whether its policy is the best, and write its points of the curves.

        Raises:
            StorageError: the disk refuses the best policy; its round and those after it wait on.
        """
        while self._waiting:
            self._best.consider(self._waiting[0])
            finished = self._waiting.pop(0)
            self._newest = max(self._newest, finished.version)
            recorder.write_evaluation(finished)

    def over(self, ingest: Ingest) -> bool:
        """Whether the newest policy's round has been considered, or no evaluator has said anything for a while."""
        if self._newest >= ingest.version:
            return True
        return time.monotonic() - ingest.evaluated_at > _EVALUATOR_SECONDS
