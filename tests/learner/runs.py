"""A small run for the tests of the learner: a tiny network, quick updates, no augmentation of effort."""

from __future__ import annotations

import numpy as np
import torch

from common.config import RunConfig
from common.messages.experience import Delivery, End
from learner.algorithm.base import PublishedVersion
from learner.algorithm.factory import make_learner
from learner.run.folder import RunFolder
from learner.trainer import Trainer
from tests.learner.experience import deliver, episode_chunks, episode_report, observation_pool

POOL = observation_pool(viewpoints=(2, 25))


def small_config(**changes: object) -> RunConfig:
    """A configuration whose updates take milliseconds; sections may be changed field by field."""
    tree: dict[str, object] = {
        "network": {"width": 16, "heads": 2, "layers": 1},
        "learner": {
            "batch_size": 4,
            "updates_per_step": 1.0,
            "total_updates": 1000,
            "publish_every": 5,
            "device": "cpu",
        },
        "replay": {"capacity": 1000, "max_bytes": 30_000_000, "min_steps": 4},
        "checkpoints": {"every_seconds": 3600.0},
        "maps": {"validation_count": 2},
    }
    for section, fields in changes.items():
        tree[section] = {**tree.get(section, {}), **fields} if isinstance(fields, dict) else fields  # type: ignore[dict-item]
    return RunConfig.model_validate({"name": "test", "seed": 5, **tree})


def make_trainer(run: RunFolder) -> tuple[Trainer, list[PublishedVersion]]:
    """A trainer with the real mathematics, and the list of what it publishes."""
    published: list[PublishedVersion] = []
    trainer = Trainer(run, make_learner(run.config, torch.device("cpu")), published.append)
    return trainer, published


PPO: dict[str, object] = {"algorithm": "ppo", "reward": {"kind": "potential"}, "ppo": {"value_only_updates": 4}}
"""Changes of `small_config` for on-policy returns; its deliveries must be labelled."""


def episodes(
    count: int, seed: int = 0, actor: str = "desk-0", first: int = 0, labelled: bool = False
) -> list[Delivery]:
    """Deliveries of whole episodes of 8 steps in two chunks, each followed by its report."""
    rng = np.random.default_rng(seed)
    bodies = []
    for episode in range(count):
        bodies += episode_chunks(rng, POOL, 8, 4, End.TERMINAL, labelled, first + episode)
        bodies.append(episode_report(distance=100.0 + episode))
    return deliver(bodies, actor)


def train_some(trainer: Trainer, updates: int) -> list[dict[str, float]]:
    """Make a number of updates by the stages of the loop; return their figures."""
    figures = []
    for _ in range(updates):
        assert trainer.data_is_ready()
        trainer.recorder.figures = {}
        trainer.learn(trainer.sample())
        figures.append(trainer.recorder.figures)
        trainer.publish_if_due()
        trainer.record_if_due()
    return figures
