"""Rounds of evaluation: one policy version on every validation world, and the best version so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from numpy.typing import NDArray

from common.messages.experience import EpisodeReport
from learner.run.episodes import EpisodeMeans, mean_episode

Policy = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, order=True)
class Score:
    """Quality of a policy: success first, then the mean distance; the greater score is the better one.

    Attributes:
        success: share of completed episodes.
        nearness: minus the mean distance, metres.
    """

    success: float
    nearness: float

    @classmethod
    def of(cls, means: EpisodeMeans) -> Score:
        """Score the means of a round."""
        return cls(means.success, -means.distance)


@dataclass(frozen=True, slots=True)
class Round:
    """A complete round of evaluation.

    Attributes:
        version: policy version.
        means: over the round's episodes.
    """

    version: int
    means: EpisodeMeans


class EvaluationRounds:
    """Collects the reports of evaluators until one version has run on all validation worlds.

    Each evaluator's reports are counted apart; when it turns to another version, or restarts, its unfinished round is
    given up.

    Args:
        worlds: number of validation worlds.
    """

    def __init__(self, worlds: int) -> None:
        self._worlds = worlds
        self._open: dict[str, tuple[int, int, dict[str, EpisodeReport]]] = {}

    def add(self, actor: str, incarnation: int, report: EpisodeReport) -> Round | None:
        """Count one report; return the round that it completes."""
        known = self._open.get(actor)
        if known is None or known[:2] != (incarnation, report.version):
            known = (incarnation, report.version, {})
            self._open[actor] = known
        reports = known[2]
        reports[report.map_name] = report
        if len(reports) < self._worlds:
            return None
        del self._open[actor]
        return Round(report.version, mean_episode(list(reports.values())))

    def state(self) -> list[Any]:
        """Return the unfinished rounds, ready for JSON."""
        return [
            [actor, incarnation, version, [asdict(report) for report in reports.values()]]
            for actor, (incarnation, version, reports) in self._open.items()
        ]

    def restore(self, state: list[Any]) -> None:
        """Take over the unfinished rounds of an earlier process."""
        self._open = {
            actor: (incarnation, version, {values["map_name"]: EpisodeReport(**values) for values in reports})
            for actor, incarnation, version, reports in state
        }

    @property
    def versions(self) -> set[int]:
        """Versions that are under evaluation now."""
        return {version for _, version, _ in self._open.values()}


class PublishedPolicies:
    """The policies published of late, so that the best version can be saved when its evaluation ends much later.

    Args:
        keep: newest versions to keep; versions under evaluation stay beyond that.
    """

    def __init__(self, keep: int = 32) -> None:
        self._keep = keep
        self._policies: dict[int, tuple[int, Policy]] = {}

    def add(self, version: int, updates: int, policy: Policy, pinned: set[int]) -> None:
        """Remember a published policy; forget the oldest beyond the limit that are not ``pinned``."""
        self._policies[version] = (updates, policy)
        for old in sorted(self._policies)[: -self._keep]:
            if old not in pinned:
                del self._policies[old]

    def get(self, version: int) -> tuple[int, Policy] | None:
        """Return (updates, weights) of a version, None when it is no longer here."""
        return self._policies.get(version)
