"""Rounds of evaluation: one policy version on every validation world."""

from __future__ import annotations

import logging
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from common.bus.keys import host_of
from common.config import RunConfig
from common.messages.experience import FAILURE, EpisodeReport
from learner.run.episodes import EpisodeMeans, mean_episode

logger = logging.getLogger(__name__)

WORST_RATIO = "worst_ratio"
_MAX_OPEN = 256
_MAX_REASONS = 100
_ANY_VERSION = 2**62


@dataclass(frozen=True, slots=True, order=True)
class Score:
    """Quality of a policy; the greater score is the better one.

    Of a mix of families of worlds the worst one counts, by the distance as a share of the classical planner's, failures
    twice; otherwise success comes first, then the mean distance.

    Attributes:
        success: share of completed episodes; 1 for a mix, whose ratio has the failures in it.
        nearness: minus the mean distance, metres, or minus the ratio.
    """

    success: float
    nearness: float

    @classmethod
    def of(cls, figures: Mapping[str, float]) -> Score:
        """Score the `Round.figures` of a round."""
        if WORST_RATIO in figures:
            return cls(1.0, -figures[WORST_RATIO])
        return cls(figures["success"], -figures["distance"])


@dataclass(frozen=True, slots=True)
class Round:
    """A complete round of evaluation.

    Attributes:
        version: policy version.
        means: over the round's episodes.
        ratios: distance of each family's episodes as a share of the classical planner's there, failures counted twice;
            empty where no classical planner was asked.
    """

    version: int
    means: EpisodeMeans
    ratios: Mapping[str, float]

    @classmethod
    def of(cls, version: int, reports: Iterable[EpisodeReport]) -> Round:
        """Sum up the reports of a round, at least one."""
        every = list(reports)
        driven: defaultdict[str, float] = defaultdict(float)
        classical: defaultdict[str, float] = defaultdict(float)
        for report in every:
            if report.classical_distance > 0.0:
                # Tasks apart: their distances have different scales.
                name = f"{report.family}/{report.task}"
                driven[name] += report.distance if report.success else FAILURE * report.distance
                classical[name] += report.classical_distance
        ratios = {name: driven[name] / classical[name] for name in sorted(driven)}
        return cls(version, mean_episode(every), ratios)

    @property
    def figures(self) -> dict[str, float]:
        """Means and ratios by name, for the policy's card."""
        worst = {WORST_RATIO: max(self.ratios.values())} if self.ratios else {}
        return {**asdict(self.means), **{f"ratio/{name}": value for name, value in self.ratios.items()}, **worst}


@dataclass(frozen=True, slots=True)
class Evaluators:
    """Whose reports of evaluation count.

    Attributes:
        hosts: those of the evaluators that were asked.
        certified: names of the run's certificates, by which hosts are told apart.
        anybody: nobody was asked by name, and nobody has a certificate by which a name could be checked.
    """

    hosts: frozenset[str]
    certified: tuple[str, ...] = ()
    anybody: bool = False

    @classmethod
    def of(cls, config: RunConfig, certified: Sequence[str] = (), own: Sequence[str] = ()) -> Evaluators:
        """Take those that the configuration names, and the learner's own ones."""
        hosts = frozenset([*config.learner.evaluators, *own])
        return cls(hosts, tuple(certified), anybody=not hosts and config.bus.tls_access is None)

    def count(self, actor: str) -> bool:
        """Whether the reports of an actor count."""
        return self.anybody or host_of(actor, self.certified) in self.hosts


def validation_of(config: RunConfig) -> dict[str, Any]:
    """Return what the figures of evaluations depend on besides the policy, ready for JSON: others compare apart."""
    apart = {"sensor_range", "viewpoint_spacing", "robot_radius", "max_steps", "unseen_area"}
    worlds = {
        f"worlds.{family.name}.{task.name}": list(config.sources(family, task.name, evaluate=True))
        for family in config.mix
        for task in config.tasks
        if family.serves(task.name)
    }
    return {
        "maps.validation_count": config.maps.validation_count,
        "maps.metres_per_pixel": config.maps.metres_per_pixel,
        **worlds,
        **{f"families.{family.name}": family.model_dump(mode="json", include=apart) for family in config.mix},
        **{f"task.{name}": value for name, value in config.task.model_dump(mode="json", exclude={"name"}).items()},
        **{f"mapping.{name}": value for name, value in config.mapping.model_dump(mode="json").items()},
    }


ANYBODY = Evaluators(frozenset(), anybody=True)


class EvaluationRounds:
    """Collects the reports of evaluators until one version has run on all validation worlds.

    Each evaluator's reports are counted apart; when it turns to another version, or restarts, its unfinished round is
    given up. Maps lie where evaluators run, and may be fewer than what was asked for: an evaluator that turned to a
    later version, and has run that in the very worlds of the one before, has no others. Whatever else claims to be an
    evaluation counts nowhere, and the log says why, once for each reason: reports of evaluators that were not asked, of
    versions that were never published, and of other worlds than those of this process's first round.

    Args:
        worlds: number of validation worlds that evaluators are asked for.
        evaluators: whose reports count.
        newest: tells the newest published version.
    """

    def __init__(
        self, worlds: int, evaluators: Evaluators = ANYBODY, newest: Callable[[], int] = lambda: _ANY_VERSION
    ) -> None:
        self._worlds = worlds
        self._evaluators = evaluators
        self._newest = newest
        self._open: OrderedDict[str, tuple[int, int, dict[str, EpisodeReport]]] = OrderedDict()
        # Worlds of the version before, of evaluators that have turned to another one by themselves.
        self._left: dict[str, frozenset[str]] = {}
        self._places: frozenset[str] = frozenset()
        self._said: set[str] = set()
        self.ignored = 0
        """Reports that counted nowhere."""

    def add(self, actor: str, incarnation: int, report: EpisodeReport) -> Round | None:
        """Count one report; return the round that it completes."""
        if reason := self._objection(actor, report):
            self.ignored += 1
            if reason not in self._said and len(self._said) < _MAX_REASONS:
                self._said.add(reason)
                logger.warning("an evaluation does not count: %s", reason)
            return None
        known = self._open.get(actor)
        if known is None or known[:2] != (incarnation, report.version):
            self._left.pop(actor, None)
            if known is not None and known[0] == incarnation and known[1] < report.version:
                self._left[actor] = frozenset(known[2])
            known = (incarnation, report.version, {})
            self._open[actor] = known
        self._open.move_to_end(actor)
        if len(self._open) > _MAX_OPEN:
            self._left.pop(self._open.popitem(last=False)[0], None)
        reports = known[2]
        reports[_place(report)] = report
        if not self._is_whole(actor, frozenset(reports)):
            return None
        del self._open[actor]
        self._left.pop(actor, None)
        self._places = frozenset(reports)
        return Round.of(report.version, reports.values())

    def _is_whole(self, actor: str, places: frozenset[str]) -> bool:
        """Whether an evaluator has run a version in all worlds that there are."""
        if len(places) >= self._worlds or places == self._places:
            return True
        if places != self._left.get(actor):
            return False
        logger.warning(
            "%s has %d validation worlds, and maps.validation_count is %d: a round of evaluation is complete with them",
            actor,
            len(places),
            self._worlds,
        )
        return True

    def _objection(self, actor: str, report: EpisodeReport) -> str:
        """Return why a report does not count; empty when it does."""
        host = host_of(actor, self._evaluators.certified)
        if not self._evaluators.count(actor):
            return (
                f"{host} is not listed as an evaluator; to let its evaluators choose the best policy, add it (--set "
                f"learner.evaluators={host})"
            )
        if not 0 <= report.version <= self._newest():
            return f"{host} reports of a version that was never published"
        if self._places and _place(report) not in self._places:
            return f"{host} drives in other worlds than those of the first round: evaluate in the run's own ones"
        return ""

    def state(self) -> list[Any]:
        """Return the unfinished rounds, ready for JSON."""
        return [
            [actor, incarnation, version, [asdict(report) for report in reports.values()]]
            for actor, (incarnation, version, reports) in self._open.items()
        ]

    def restore(self, state: list[Any]) -> None:
        """Take over the unfinished rounds of an earlier process."""
        self._open = OrderedDict()
        for actor, incarnation, version, values in state:
            reports = [EpisodeReport(**each) for each in values]
            self._open[actor] = incarnation, version, {_place(report): report for report in reports}

    @property
    def versions(self) -> set[int]:
        """Versions that are under evaluation now."""
        return {version for _, version, _ in self._open.values()}


def _place(report: EpisodeReport) -> str:
    return f"{report.family}/{report.task}/{report.map_name}"
