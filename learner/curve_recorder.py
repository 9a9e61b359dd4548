"""The curves of a run: gathers figures from all parts and writes a point every few updates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from learner.ingest import Ingest
from learner.run.disk import DiskWatch
from learner.run.episodes import GROUPS
from learner.run.evaluation import Round
from learner.watch.metrics import Curves, Means, RateMeter
from learner.watch.writers import Writer

LOG_EVERY = 10
"""Updates between two points of the curves."""


class CurveRecorder:
    """Figures of training between two points, and the curves that they go to. docs/metrics.md explains each.

    Args:
        folder: of the TensorBoard events.
        ingest: what collecting has brought.
        update: updates so far; see `Curves`.
        disk: is told when the disk refuses something.
        writers: take every point too; closed together with this.
    """

    def __init__(
        self,
        folder: Path,
        ingest: Ingest,
        update: int = 0,
        disk: DiskWatch | None = None,
        writers: Sequence[Writer] = (),
    ) -> None:
        self._writers = writers
        self._curves = Curves(folder, update, disk)
        self._ingest = ingest
        self._figures = Means()
        self._means = Means()
        self.updates_rate = RateMeter(window=20.0)
        self.figures: dict[str, float] = {}
        """Newest means of what updates report."""
        self.evaluated: Round | None = None
        """Newest complete round of evaluation."""

    def note(self, name: str, value: float) -> None:
        """Add one value to the mean of a curve's next point."""
        self._means.add({name: value})

    def note_update(self, figures: dict[str, float]) -> None:
        """Add what one update reports."""
        self._figures.add(figures)
        self.figures = self.figures or figures
        self.updates_rate.add()

    def write(self) -> None:
        """Write one point of every curve."""
        ingest, limiter, replay = self._ingest, self._ingest.limiter, self._ingest.replay
        self.figures = self._figures.take() or self.figures
        values = {
            **self.figures,
            **self._means.take(),
            **ingest.means.take(),
            "collect/steps": limiter.steps,
            "collect/steps_per_second": ingest.steps_rate.rate,
            "collect/episodes": ingest.episode_count,
            "replay/transitions": len(replay),
            "replay/fill": replay.fill,
            "replay/megabytes": replay.bytes / 1e6,
            "ratio/actual": limiter.actual,
            "ratio/lead_steps": limiter.lead,
            "ratio/hold_seconds": limiter.hold(),
            "time/updates_per_second": self.updates_rate.rate,
            "policy/version": ingest.version,
        }
        for group in GROUPS:
            late = ingest.episodes.means(group)
            if late is not None:
                values |= _named(f"episode_{group}", asdict(late))
        self._write(limiter.updates, values)

    def write_evaluation(self, finished: Round) -> None:
        """Write the point of a complete round of evaluation."""
        self.evaluated = finished
        self._write(self._ingest.limiter.updates, _named("evaluation", finished.figures))

    def write_text(self, name: str, content: str) -> None:
        """Write a text, such as the configuration."""
        self._curves.text(name, content)
        for writer in self._writers:
            writer.text(name, content)

    def write_summary(self, values: Mapping[str, Any]) -> None:
        """Give the figures of the whole run to the trackers."""
        for writer in self._writers:
            writer.summary(values)

    def state(self) -> dict[str, Any]:
        """Return the figures since the last point, ready for JSON."""
        return self._figures.state()

    def restore(self, state: dict[str, Any]) -> None:
        """Take over the figures of an earlier process."""
        self._figures.restore(state)

    def flush(self) -> None:
        """Bring all points to the files."""
        self._curves.flush()

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        self._curves.close()
        for writer in self._writers:
            writer.close()

    def _write(self, update: int, values: Mapping[str, float]) -> None:
        self._curves.write(update, values)
        for writer in self._writers:
            writer.write(update, values)


def _named(group: str, means: dict[str, float]) -> dict[str, float]:
    return {f"{group}/{name}": value for name, value in means.items() if name != "count"}
