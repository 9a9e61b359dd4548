"""Looks through everything that a run keeps on the disk, and takes out what cannot be used; nothing is thrown away."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from common.bus.seen import SeenSet
from common.errors import CheckpointError, MessageError, StorageError
from common.messages.experience import Delivery
from common.messages.schema import decode
from learner.run.checkpoints import CheckpointStore
from learner.run.episodes import damaged_lines, mend_episodes
from learner.run.event_file import PATTERN, mend_events
from learner.run.files import DAMAGED
from learner.run.folder import OLDEST_CONTINUED, check_run, lock_run, read_config
from learner.run.records import Found, RecordKind, segment_paths
from learner.run.repair import mend, missing_deliveries, review


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that the doctor says about a run.

    Attributes:
        text: what was found.
        wrong: it is damage or poison, and not just news.
        mended: it is out of the way now.
    """

    text: str
    wrong: bool = False
    mended: bool = False


def examine(path: Path, *, repair: bool = False) -> list[Finding]:
    """Examine the run in ``path``, on which no learner may work meanwhile.

    Args:
        path: folder of the run.
        repair: set everything aside that cannot be used, under `damaged/` and `checkpoints/damaged-...`.

    Raises:
        CheckpointError: when there is no such run, or a learner works on it.
        StorageError: when the disk refuses a repair; what was mended before stays so.
    """
    written = check_run(path)
    try:
        with _locked(path, repair):
            findings = [*_configuration(path), *_checkpoints(path, repair)]
            if written >= OLDEST_CONTINUED:
                findings += _journal(path, repair)
            return [*findings, *_episodes(path, repair), *_curves(path, repair)]
    except OSError as error:
        doing = "repair" if repair else "examine"
        raise StorageError(f"cannot {doing} {path}: {error}; check its permissions, and make room") from error


def _locked(path: Path, repair: bool) -> AbstractContextManager[object]:
    """Keep learners out; who only looks may do so in a folder that is somebody else's, or on a read-only disk."""
    try:
        return lock_run(path)
    except OSError as error:
        if repair or error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
    return lock_run(path, read_only=True) if (path / "lock").exists() else nullcontext()


def _configuration(path: Path) -> Iterator[Finding]:
    try:
        read_config(path)
    except CheckpointError as error:
        earlier = ", ".join(sorted(file.name for file in path.glob("config.*.json"))) or "none"
        yield Finding(f"{error}; earlier ones that could take its place: {earlier}", wrong=True)


def _checkpoints(path: Path, repair: bool) -> Iterator[Finding]:
    store = CheckpointStore(path / "checkpoints", keep=2, writer=False)
    damaged = store.damaged()
    sound = [name for name in store.names() if name not in damaged]
    yield Finding(f"checkpoints: {len(sound)} valid, the newest is {sound[-1]}" if sound else "checkpoints: none valid")
    for name, problem in damaged.items():
        # Without a sound one they stay where they are: what is left may still be of use to somebody.
        mended = repair and bool(sound)
        if mended:
            store.set_aside(name)
        yield Finding(problem, wrong=True, mended=mended)
    for which in store.damaged_pointers():
        yield Finding(f"checkpoints/{which} names no checkpoint", wrong=True, mended=repair)
    if repair:
        store.mend_pointers()


def _journal(path: Path, repair: bool) -> Iterator[Finding]:
    seen = SeenSet()

    def poison(record: Found) -> str:
        if record.kind == RecordKind.VERSION:
            return ""
        if record.kind != RecordKind.DELIVERY:
            return f"of the unknown kind {record.kind}"
        try:
            delivery = decode(record.payload, Delivery)
        except MessageError as error:
            return f"no valid delivery: {error}"
        seen.add(delivery.actor, delivery.incarnation, delivery.sequence)
        return ""

    segments = segment_paths(path / "journal")
    found = review(segments, poison)
    yield Finding(f"journal: {found.sound} valid records in {len(segments)} segments, {len(seen)} deliveries in them")
    if found.torn:
        yield Finding(
            f"journal: {found.torn} bytes at the end belong to a record that was never acknowledged; resuming "
            "removes them"
        )
    if repair and found.losses:
        mend(segments, found, path / DAMAGED)
    for loss in found.losses:
        yield Finding(f"journal: {loss}", wrong=True, mended=repair)
    if found.losses and (missing := missing_deliveries(seen)):
        yield Finding(f"journal: deliveries between others that are not in it: {missing}")


def _episodes(path: Path, repair: bool) -> Iterator[Finding]:
    file = path / "episodes.jsonl"
    if not file.is_file():
        return
    bad = damaged_lines(file)
    if bad:
        numbers = ", ".join(str(number + 1) for number in bad[:20]) + (", ..." if len(bad) > 20 else "")
        if repair:
            mend_episodes(file, path / DAMAGED)
        yield Finding(f"episodes.jsonl: {len(bad)} lines cannot be read: {numbers}", wrong=True, mended=repair)
    else:
        yield Finding("episodes.jsonl: ok")


def _curves(path: Path, repair: bool) -> Iterator[Finding]:
    files = sorted((path / "tensorboard").glob(PATTERN))
    sound = True
    for file in files:
        if lost := mend_events(file, path / DAMAGED, dry=not repair):
            sound = False
            yield Finding(f"tensorboard/{file.name}: {lost} bytes are no event", wrong=True, mended=repair)
    if sound:
        yield Finding(f"tensorboard: {len(files)} files, ok")
