"""Taking damage out of a journal: what is sound stays, what is not is set aside, and both are told exactly."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from common.bus.seen import SeenSet
from common.messages.schema import NO_MESSAGE, describe_delivery
from learner.run.files import replace_bytes, set_aside, sync_path
from learner.run.records import Found, scan

Poison = Callable[[Found], str]
"""Says what is wrong with a sound record that must go all the same; empty text for one that stays."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Bytes of a segment that are no part of the journal any more.

    Attributes:
        segment: name of the segment's file.
        start: first byte, in the file as it was.
        length: bytes.
        first: number of the first record that is missing, -1 where it is not known.
        count: records that are missing, None where it is not known, as at the end of a journal.
        reason: what is wrong with them.
        last: number of the last record that is known to have been there, -1 for none.
        messages: whose they were, as far as what is left of them tells; it may be wrong.
    """

    segment: str
    start: int
    length: int
    first: int
    count: int | None
    reason: str
    last: int = -1
    messages: tuple[str, ...] = ()

    @property
    def file(self) -> str:
        """Name of the file that the bytes are set aside in."""
        return f"{Path(self.segment).stem}-at-{self.start}.bin"

    def __str__(self) -> str:
        if self.count is None and self.last >= 0:
            first = self.first if self.first >= 0 else self.last
            records = f"records {first} to {self.last}" if first < self.last else f"record {self.last}"
            records += " and possibly others"
        elif self.count is None:
            records = "an unknown number of records" + (f" from {self.first} on" if self.first >= 0 else "")
        elif self.count == 1:
            records = f"record {self.first}"
        else:
            records = f"records {self.first} to {self.first + self.count - 1}" if self.count else "no record"
        told = f", by what is left of them {'; '.join(self.messages)}" if self.messages else ""
        return f"{self.segment} from byte {self.start}, {self.length} bytes: {records} ({self.reason}{told})"


class Review(NamedTuple):
    """What a journal's segments hold.

    Attributes:
        losses: what is damaged or poisoned, in the order of the journal.
        sound: records that stay.
        next_number: number behind that of the last record, 0 without any.
        torn: bytes at the end of the newest segment of a record that its writer could not finish.
        keep: parts of each damaged segment that stay, (start, end).
    """

    losses: list[Loss]
    sound: int
    next_number: int
    torn: int
    keep: dict[Path, list[tuple[int, int]]]


def review(segments: Mapping[int, Path], poison: Poison | None = None) -> Review:
    """Read all segments of a journal and say what is wrong with them; nothing is changed.

    Args:
        segments: file of each segment by its number.
        poison: for records that are sound, and must go for what they hold.
    """
    losses: list[Loss] = []
    keep: dict[Path, list[tuple[int, int]]] = {}
    sound, expected, torn = 0, -1, 0
    newest = max(segments, default=0)
    for number in sorted(segments):
        path = segments[number]
        parts: list[tuple[int, int]] = []
        before = len(losses)
        for part in scan(path):
            if isinstance(part, Found):
                losses[:] = _counted(losses, part.number)
                expected = part.number + 1 if part.number >= 0 else -1
                reason = poison(part) if poison else ""
                if reason:
                    losses.append(Loss(path.name, part.start, part.end - part.start, part.number, 1, reason))
                else:
                    parts.append((part.start, part.end))
                    sound += 1
            elif part.torn and number == newest:
                torn = part.end - part.start
            else:
                reason = "unfinished" if part.torn else "damaged"
                last = part.remains[-1][0] if part.remains else -1
                told = tuple(text for _, payload in part.remains if (text := describe_delivery(payload)) != NO_MESSAGE)
                losses.append(Loss(path.name, part.start, part.end - part.start, expected, None, reason, last, told))
        if len(losses) > before:
            keep[path] = parts
    return Review(losses, sound, max(expected, 0), torn, keep)


def mend(segments: Mapping[int, Path], found: Review, aside: Path) -> None:
    """Take what a review found out of the segments.

    The end of the newest segment that its writer could not finish is cut off: it was never acknowledged. Everything
    else goes into a file of its own, and its segment is replaced at one stroke by one without it.

    Args:
        segments: as they were reviewed.
        found: by `review`.
        aside: folder for what is taken out; made when missing.
    """
    named = {path.name: path for path in segments.values()}
    for loss in found.losses:
        set_aside(aside, loss.file, _read(named[loss.segment], loss.start, loss.length))
    newest = segments[max(segments)] if segments else None
    if newest is not None and found.torn and newest not in found.keep:
        os.truncate(newest, newest.stat().st_size - found.torn)
        sync_path(newest)
    for path, parts in found.keep.items():
        if parts:
            replace_bytes(path, b"".join(_read(path, start, end - start) for start, end in parts))
        else:
            path.unlink()
            sync_path(path.parent)


def _counted(losses: list[Loss], number: int) -> list[Loss]:
    """Fill in how many records the last loss has cost, now that the number of the next sound one is known."""
    if losses and losses[-1].count is None and number >= 0 and losses[-1].first >= 0:
        return [*losses[:-1], replace(losses[-1], count=max(0, number - losses[-1].first))]
    return losses


def _read(path: Path, start: int, length: int) -> bytes:
    with path.open("rb") as file:
        file.seek(start)
        return file.read(length)


def missing_deliveries(seen: SeenSet) -> str:
    """Name the deliveries between others of the same actor that were never stored; empty when there are none."""
    gaps = []
    for (actor, incarnation), ranges in sorted(seen.streams().items()):
        missing = [f"{end} to {first - 1}" for (_, end), (first, _) in pairwise(ranges)]
        if missing:
            gaps.append(f"{actor} (incarnation {incarnation}) {', '.join(missing)}")
    return "; ".join(gaps)
