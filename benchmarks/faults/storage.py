"""Disks that fail: full, without power, and with damaged files."""

from __future__ import annotations

import random
import re
import tempfile
import time
from pathlib import Path

from benchmarks.faults.processes import judged
from benchmarks.faults.rig import Rig
from benchmarks.faults.table import Row
from learner.run.records import Found, scan, segment_paths
from tests.learner.power.failures import CannotRecordError, fail, record
from tests.learner.power.victim import EPISODES
from tests.rigs.learner import until


def full(rig: Rig, seconds: float) -> Row:
    """Fill the disk of the run for a while."""
    fault = f"the disk is full for {seconds:g} s"
    expected = "holds, says so once, continues"
    if rig.disk is None:
        return Row(fault, expected, "not tried: a small file system cannot be mounted here", wrong="not tried")
    with rig.said() as said:
        rig.disk.fill()
        time.sleep(seconds)
        state = rig.status()["state"]
        rig.disk.empty()
        since = time.monotonic()
        resumes = rig.resumed(since)
        deadline = since + 10.0
        while rig.status()["state"] == "disk full" and time.monotonic() < deadline:
            time.sleep(0.1)
    holds, rooms = said[0].count("The learner pauses"), said[0].count("there is space on the disk again")
    seen = f"state '{state}', said {holds} times, {len(said[0]):,} characters of log"
    problem = "" if (state, holds, rooms) == ("disk full", 1, 1) else f"said {holds} and {rooms} times"
    return judged(rig, fault, expected, seen, said[0], resumes, problem)


def damaged(rig: Rig, records: int, rng: random.Random) -> Row:
    """Damage every kind of file of a killed run, then resume it."""
    runs = rig.learner.run_folder
    # One is damaged, and behind the very first one everything would come from the journal.
    until(lambda: len(list((runs / "checkpoints").glob("[0-9]*[1-9]*"))) >= 2)
    rig.learner.kill()
    before = rig.stored()
    names = _spoil_journal(runs / "journal", records, rng)
    lost = before.keys() - rig.stored().keys()
    rig.damaged |= {key: before[key] for key in lost}
    others = {
        "a checkpoint": (_flip_newest(runs / "checkpoints", "[0-9]*/*.safetensors", rng), "damaged"),
        "episodes.jsonl": (_flip_newest(runs, "episodes.jsonl", rng, byte=0), "episodes.jsonl"),
        "TensorBoard": (_flip_newest(runs / "tensorboard", "events*", rng), "tensorboard"),
        "the pointer last": (_overwrite(runs / "checkpoints" / "last", b"nowhere\n"), "last"),
    }
    spoilt = [what for what, (done, _) in others.items() if done]
    with rig.said() as said:
        since = time.monotonic()
        rig.learner.launch("resume")
        resumes = rig.resumed(since, 100.0)
    log = said[0]
    unnamed = [number for number in names if not _told(log, number)]
    silent = [what for what, (done, word) in others.items() if done and word not in log]
    fault = f"{len(names)} damaged records and a page of zeros in the journal; {', '.join(spoilt)}"
    seen = f"{len(lost)} messages and {len(names)} records gone, {len(names) - len(unnamed)} named"
    problems = [f"not named: {unnamed}" if unnamed else "", f"nothing said of {', '.join(silent)}" if silent else ""]
    expected = "resumes with all that is sound, names the rest"
    return judged(rig, fault, expected, seen, log, resumes, *problems, within=60.0)


def power(failures: int) -> Row:
    """Record a learner's file operations, and let the power fail at random moments."""
    fault = f"the power fails at {failures} random moments"
    expected = "resumes with all that was acknowledged"
    with tempfile.TemporaryDirectory() as folder:
        try:
            recording = record(Path(folder))
        except CannotRecordError as error:
            return Row(fault, expected, f"not tried: {error}", wrong="not tried")
        began = time.monotonic()
        costs = fail(recording, failures, 1, Path(folder))
    lost = sum(len(cost) for cost in costs)
    seen = f"{len(costs)} runs resumed, {len(recording[2]):,} operations; each in {_mean(began, len(costs)):.1f} s"
    return Row(fault, expected, seen, 3 * EPISODES, lost, 0, None, "acknowledged messages are lost" if lost else "")


def _mean(began: float, count: int) -> float:
    return (time.monotonic() - began) / max(1, count)


def _spoil_journal(folder: Path, count: int, rng: random.Random) -> list[int]:
    """Flip one bit in some records, and overwrite one page with zeros; return the numbers of the records that go."""
    places = [
        (path, record)
        for _, path in sorted(segment_paths(folder).items())
        for record in scan(path)
        if isinstance(record, Found)
    ]
    for path, found in rng.sample(places, min(count, len(places))):
        _flip(path, rng.randrange(found.start, found.end), rng)
    path, found = places[len(places) // 2]
    with path.open("r+b") as file:
        file.seek(found.start)
        file.write(bytes(min(4096, path.stat().st_size - found.start)))
    sound = {
        record.number for path in segment_paths(folder).values() for record in scan(path) if isinstance(record, Found)
    }
    return sorted({record.number for _, record in places} - sound)


def _told(log: str, number: int) -> bool:
    """Whether a record is named among the losses."""
    for line in log.splitlines():
        if "lost from the journal" in line:
            named = re.search(r" bytes: records? (\d+)(?: to (\d+))?", line)
            if named and int(named[1]) <= number <= int(named[2] or named[1]):
                return True
    return False


def _flip(path: Path, at: int, rng: random.Random) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        byte = file.read(1)[0]
        file.seek(at)
        file.write(bytes([byte ^ 1 << rng.randrange(8)]))


def _flip_newest(folder: Path, pattern: str, rng: random.Random, byte: int | None = None) -> bool:
    files = sorted(folder.glob(pattern), key=lambda path: path.stat().st_mtime)
    if not files or not files[-1].stat().st_size:
        return False
    _flip(files[-1], rng.randrange(files[-1].stat().st_size) if byte is None else byte, rng)
    return True


def _overwrite(path: Path, content: bytes) -> bool:
    if not path.exists():
        return False
    path.write_bytes(content)
    return True
