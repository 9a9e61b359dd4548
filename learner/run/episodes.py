"""The record of finished episodes: one line of JSON each, and the means of the late ones."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
import math
import os
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from common.errors import StorageError, refusal
from common.messages.experience import EpisodeReport
from common.system.documents import parse_json
from learner.run.disk import DiskWatch
from learner.run.files import DAMAGED, replace_bytes, set_aside, sync_descriptor, sync_path, write_all

logger = logging.getLogger(__name__)

Group = Literal["train", "expert", "evaluate"]
GROUPS: tuple[Group, ...] = ("train", "expert", "evaluate")

LATE = 100
"""Episodes over which late means are taken."""

_FIELDS = dataclasses.fields(EpisodeReport)
_CONTEXT = {"time": "float", "actor": "str", "updates": "int"}
"""What the learner adds to a report, by its kind; there may be more."""


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

    Lines that the disk refuses wait in memory for the next time; whatever becomes of the process, the journal has their
    reports too until a checkpoint has noted the lines. Lines that cannot be read are set aside on opening, and blanks
    stand in their place, so that the lengths in older checkpoints stay right.

    Args:
        path: the file; what lies beyond ``length`` is cut off, the lines before fill the late means.
        length: bytes that count, all by default.
        disk: is told when the disk refuses lines.

    Raises:
        StorageError: when the disk refuses the file.
    """

    def __init__(self, path: Path, length: int | None = None, disk: DiskWatch | None = None) -> None:
        self._path = path
        self._disk = disk or DiskWatch(path.parent)
        self._late: dict[Group, deque[EpisodeReport]] = {group: deque(maxlen=LATE) for group in GROUPS}
        self._waiting: list[bytes] = []
        try:
            path.touch()
            sync_path(path.parent)
            if length is not None:
                self._cut(length)
            self._recall()
            self._descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
        except OSError as error:
            raise StorageError(f"cannot write {path}: {refusal(error)}") from error
        self._length = path.stat().st_size

    @property
    def length(self) -> int:
        """Bytes of the file so far."""
        return self._length

    def append(self, report: EpisodeReport, *, time: float, actor: str, updates: int, **context: Any) -> None:
        """Write one line: the report, and what the learner adds to it.

        Args:
            report: of a finished episode.
            time: Unix seconds.
            actor: name of the actor that sent it.
            updates: of the run so far.
            context: more values for JSON.
        """
        self._late[group_of(report)].append(report)
        self._waiting.append(
            json.dumps(
                {"time": time, "actor": actor, "updates": updates, **context, **dataclasses.asdict(report)}
            ).encode()
            + b"\n"
        )
        # What the disk refuses waits: the report itself is in the journal.
        with contextlib.suppress(StorageError):
            self.flush()

    def flush(self) -> None:
        """Write the lines that wait for the disk.

        Raises:
            StorageError: when it still refuses them; the file holds whole lines alone.
        """
        while self._waiting:
            line = self._waiting[0]
            try:
                write_all(self._descriptor, line)
            except OSError as error:
                with contextlib.suppress(OSError):
                    os.ftruncate(self._descriptor, self._length)
                problem = StorageError(f"cannot write {self._path}: {refusal(error)}", len(line))
                self._disk.refused(problem)
                raise problem from error
            self._length += len(line)
            self._waiting.pop(0)

    def sync(self) -> None:
        """Bring all written lines onto the disk.

        Raises:
            StorageError: when it refuses.
        """
        try:
            sync_descriptor(self._descriptor)
        except OSError as error:
            raise StorageError(f"cannot sync {self._path}: {refusal(error)}") from error

    def means(self, group: Group) -> EpisodeMeans | None:
        """Means over the late episodes of a group, None before the first."""
        late = list(self._late[group])
        return mean_episode(late) if late else None

    def close(self) -> None:
        """Close the file; safe to call twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _cut(self, length: int) -> None:
        size = self._path.stat().st_size
        if size < length:
            logger.error("%s: %d bytes at the end are missing, with the episodes in them", self._path, length - size)
        elif size > length:
            os.truncate(self._path, length)

    def _recall(self) -> None:
        """Fill the late means; take lines that are no reports out."""
        damaged = mend_episodes(self._path, self._path.parent / DAMAGED)
        if damaged:
            logger.error("%s: %d damaged lines are lost; their bytes are kept in %s", self._path, *damaged)
        for _, report in read_episodes(self._path):
            self._late[group_of(report)].append(report)


def read_episodes(path: Path) -> Iterator[tuple[dict[str, Any], EpisodeReport]]:
    """Yield the values of each line and the report in it; lines that cannot be read are left out."""
    with path.open("rb") as file:
        for line in file:
            found = _read_line(line)
            if found is not None:
                yield found


def damaged_lines(path: Path) -> list[int]:
    """Return the numbers of the lines that cannot be read, from 0; blank ones stand for lines that were lost before."""
    lines = _lines(path)
    return [number for number, line in enumerate(lines) if line.strip(b" \n") and _read_line(line) is None]


def mend_episodes(path: Path, aside: Path) -> tuple[int, Path] | None:
    """Put blanks of the same length in the place of lines that cannot be read, and set those aside in one file.

    Returns:
        Number of the lines and the file that has them now; None when there were none.
    """
    bad = damaged_lines(path)
    if not bad:
        return None
    lines = _lines(path)
    kept = set_aside(aside, f"{path.stem}-line-{bad[0] + 1}.bin", b"".join(lines[number] for number in bad))
    for number in bad:
        lines[number] = b" " * (len(lines[number]) - 1) + b"\n"
    replace_bytes(path, b"".join(lines))
    return len(bad), kept


def _lines(path: Path) -> list[bytes]:
    with path.open("rb") as file:
        return file.readlines()


def _read_line(line: bytes) -> tuple[dict[str, Any], EpisodeReport] | None:
    """Read one line that ends with a line feed; None unless it has every figure that a report and a plot need."""
    if not line.endswith(b"\n"):
        return None
    try:
        values = parse_json(line)
    except ValueError:
        return None
    if not isinstance(values, dict) or not all(_is_kind(values.get(name), kind) for name, kind in _CONTEXT.items()):
        return None
    given = {field.name: values[field.name] for field in _FIELDS if field.name in values}
    # Fields with a default are newer than some runs.
    needed = (field for field in _FIELDS if field.name in given or field.default is dataclasses.MISSING)
    if not all(_is_kind(given.get(field.name), str(field.type)) for field in needed):
        return None
    return values, EpisodeReport(**given)


def _is_kind(value: object, kind: str) -> bool:
    if isinstance(value, bool):
        return kind == "bool"
    if kind == "float":
        return isinstance(value, int | float) and math.isfinite(value)
    return isinstance(value, {"str": str, "int": int}.get(kind, ()))
