"""The record of finished episodes: one line of JSON each, and the means of the late ones."""

from __future__ import annotations

import dataclasses
import json
import os
from collections import deque
from pathlib import Path
from typing import Any, Literal

from common.messages.experience import EpisodeReport

Group = Literal["train", "expert", "evaluate"]
GROUPS: tuple[Group, ...] = ("train", "expert", "evaluate")

LATE = 100
"""Episodes over which late means are taken."""


@dataclasses.dataclass(frozen=True, slots=True)
class EpisodeMeans:
    """Means over the late episodes of one group.

    Attributes:
        count: episodes behind the means, `LATE` at most.
        distance: metres.
        success: share that completed the task, 0 to 1.
        explored: share of the reachable free area that was seen, 0 to 1.
        reward: sum of rewards.
        steps: decisions.
        collisions: contacts with the world.
    """

    count: int
    distance: float
    success: float
    explored: float
    reward: float
    steps: float
    collisions: float


def group_of(report: EpisodeReport) -> Group:
    """Tell episodes of evaluation, of the driving expert, and of the learning policy apart."""
    if report.role == "evaluate":
        return "evaluate"
    return "expert" if report.driver == "expert" else "train"


def mean_episode(reports: list[EpisodeReport]) -> EpisodeMeans:
    """Average at least one report."""
    n = len(reports)
    return EpisodeMeans(
        count=n,
        distance=sum(r.distance for r in reports) / n,
        success=sum(r.success for r in reports) / n,
        explored=sum(r.explored for r in reports) / n,
        reward=sum(r.reward for r in reports) / n,
        steps=sum(r.steps for r in reports) / n,
        collisions=sum(r.collisions for r in reports) / n,
    )


class EpisodeLog:
    """Appends reports to `episodes.jsonl` and keeps the late ones of each group.

    Args:
        path: the file; lines beyond ``length`` are cut off, the others fill the late means.
        length: bytes that count, all by default.
    """

    def __init__(self, path: Path, length: int | None = None) -> None:
        self._path = path
        self._late: dict[Group, deque[EpisodeReport]] = {group: deque(maxlen=LATE) for group in GROUPS}
        path.touch()
        if length is not None and length < path.stat().st_size:
            os.truncate(path, length)
        self._recall()
        self._descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
        self._length = path.stat().st_size

    @property
    def length(self) -> int:
        """Bytes of the file so far."""
        return self._length

    def append(self, report: EpisodeReport, **context: Any) -> None:
        """Write one line: the report, and what the learner adds to it."""
        line = json.dumps({**context, **dataclasses.asdict(report)}).encode() + b"\n"
        os.write(self._descriptor, line)
        self._length += len(line)
        self._late[group_of(report)].append(report)

    def means(self, group: Group) -> EpisodeMeans | None:
        """Means over the late episodes of a group, None before the first."""
        late = list(self._late[group])
        return mean_episode(late) if late else None

    def close(self) -> None:
        """Close the file; safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _recall(self) -> None:
        names = {field.name for field in dataclasses.fields(EpisodeReport)}
        with self._path.open("rb") as file:
            for line in file:
                values = json.loads(line)
                report = EpisodeReport(**{name: values[name] for name in names})
                self._late[group_of(report)].append(report)
