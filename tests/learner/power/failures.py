"""Power failures of a recorded learner: what each leaves is resumed, and what was acknowledged is looked for."""

import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

from common.messages.experience import Chunk
from learner.run.folder import RunFolder
from tests.learner.power.disk_model import DiskModel, Kept, read_log
from tests.learner.power.victim import CONFIG, EPISODES
from tests.learner.runs import episodes, make_trainer

SOURCE = Path(__file__).with_name("record_io.c")


class CannotRecordError(Exception):
    """File operations cannot be recorded on this machine."""


def record(folder):
    """Let a learner work in `folder`; return its run's root, the root's inode, and all file operations."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or not sys.platform.startswith("linux"):
        raise CannotRecordError("recording file operations needs Linux and a C compiler (cc, gcc or clang)")
    library, root, log = folder / "record_io.so", folder / "disk", folder / "operations"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", library, SOURCE, "-ldl", "-lpthread"], check=True)
    root.mkdir()
    environment = {**os.environ, "LD_PRELOAD": str(library), "HD_IO_ROOT": str(root), "HD_IO_LOG": str(log)}
    command = [sys.executable, "-m", "tests.learner.power.victim", str(root), "1"]
    subprocess.run(command, env=environment, check=True, timeout=200)
    return root, root.stat().st_ino, read_log(log)


def any_moments(recording, points, seed):
    """Draw places between the recorded operations."""
    chance = random.Random(seed)
    return [chance.randrange(len(recording[2]) + 1) for _ in range(points)]


def moments_between_syncs(recording, points, seed):
    """Draw places behind a delivery that was taken and is not on the disk: no sync began since the one before it."""
    found, synced = [], True
    for place, operation in enumerate(recording[2], start=1):
        if operation.code == "s":
            synced = True
        elif operation.first.startswith(b"taken"):
            if not synced:
                found.append(place)
            synced = False
    return random.Random(seed).sample(found, points)


def fail(recording, moments, seed, folder, word="stored", kept=tuple(Kept)):
    """Let the power fail at moments; return which acknowledged deliveries each has cost, the earliest first.

    The learner is started again on what each failure left, and the actors deliver again what they have no
    acknowledgement for: every step must be counted once in the end.
    """
    root, inode, operations = recording
    chance = random.Random(seed)
    made = episodes(EPISODES)
    model = DiskModel(root, kept)
    model.learn_root(inode)
    done, lost = 0, []
    for number, moment in enumerate(sorted(moments)):
        for operation in operations[done:moment]:
            model.replay(operation)
        done = max(done, moment)
        left = folder / str(number)
        left.mkdir()
        model.crash(left, chance)
        acknowledged = {int(mark.split()[1]) for mark in model.marks if mark.startswith(word)}
        lost.append(acknowledged - recovered(left, made, acknowledged))
        shutil.rmtree(left)
    return lost


def recovered(left, made, acknowledged):
    """Start again as a user does; return the sequence numbers of the deliveries that are there."""
    runs = left / "runs"
    begun = (runs / CONFIG.name).exists()
    with RunFolder.open(runs, CONFIG.name) if begun else RunFolder.create(runs, CONFIG) as run:
        trainer, _ = make_trainer(run)
        trainer.resume()
        there = {d.sequence for d in made if (d.actor, d.incarnation, d.sequence) in trainer.ingest._seen}
        assert trainer.limiter.steps == sum(d.body.steps for d in made if d.sequence in there and is_chunk(d))
        for delivery in made:
            if delivery.sequence not in acknowledged:
                trainer.ingest.store(delivery)
        if there >= acknowledged:
            assert trainer.limiter.steps == 8 * EPISODES
            assert trainer.ingest.episode_count == EPISODES
            assert sum(bool(line.strip()) for line in run.episodes.read_text().splitlines()) == EPISODES
        trainer.close()
    return there


def is_chunk(delivery):
    return isinstance(delivery.body, Chunk)
