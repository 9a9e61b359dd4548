"""A learner without a bus whose file operations are recorded: ``python -m tests.learner.power.victim ROOT SEED``.

It marks each delivery when it is taken, and when its acknowledgement would be sent.
"""

from __future__ import annotations

import ctypes
import functools
import random
import sys
import time
from pathlib import Path

import torch
from safetensors.torch import save

import learner.run.checkpoints
import learner.trainer
from learner.run.folder import RunFolder
from learner.run.journal import Journal
from tests.learner.runs import episodes, make_trainer, small_config, train_some

EPISODES = 30
CONFIG = small_config(replay={"capacity": 150}, journal={"sync_seconds": 0.01}, learner={"publish_every": 2})


def main(root: Path, seed: int) -> None:
    torch.set_num_threads(1)
    chance = random.Random(seed)
    mark = ctypes.CDLL(None).hd_mark
    # Small segments: beginning one must be as safe as writing into it.
    learner.trainer.Journal = functools.partial(Journal, segment_bytes=30_000)
    # Its library renames a temporary file by a call that no preloaded library sees.
    learner.run.checkpoints.save_file = lambda tensors, path: path.write_bytes(save(tensors))
    with RunFolder.create(root / "runs", CONFIG) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        mark(b"begun")
        for number, delivery in enumerate(episodes(EPISODES)):
            trainer.ingest.store(delivery)
            mark(f"taken {delivery.sequence}".encode())
            word = f"stored {delivery.sequence}".encode()
            trainer.commit.when_synced(lambda durable, word=word: mark(word) if durable else None)
            time.sleep(chance.choice([0.0, 0.0, 0.002, 0.02]))
            if number % 20 == 10:
                train_some(trainer, 2)
            if number % 23 == 22:
                trainer.checkpoint()
        trainer.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
