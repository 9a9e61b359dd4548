"""Runs planners in large worlds; as `hd-eval run` does, with results of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from actors.evaluation.episode import Outcome
from actors.evaluation.large.episode import LargeOutcome
from actors.evaluation.large.results import LargeResults, episode_result, write_large_results
from actors.evaluation.large.settings import LargeSettings
from actors.evaluation.runner import Evaluation


class LargeEvaluation(Evaluation):
    """All episodes of some planners in some large worlds, in a folder; see `Evaluation`."""

    worker_module: ClassVar[str] = "actors.evaluation.large.worker"
    outcome_kind: ClassVar[type[Outcome]] = LargeOutcome

    def __init__(self, settings: LargeSettings, planners: Sequence[str], out: Path, *, overwrite: bool = False) -> None:
        """Check everything that can be checked before the work starts; see `Evaluation`."""
        self._large = settings
        super().__init__(settings, planners, out, overwrite=overwrite)

    def _write_results(self, planner: str, commit: str, named: Sequence[tuple[str, Outcome]]) -> None:
        settings = self._large
        results = LargeResults(
            task=settings.task.kind.name,
            metres_per_pixel=settings.metres_per_pixel,
            sensor_range_m=settings.mapping.sensor_range,
            planner=planner,
            commit=commit,
            seed=settings.seed,
            settings=settings.fingerprint(planner),
            worlds=self.worlds,
            episodes=[episode_result(name, outcome) for name, outcome in named],
        )
        write_large_results(self.results_file(planner), results)
