import numpy as np
import pytest
import torch

from learner.algorithm.factory import make_learner
from learner.prefetch import Prefetch
from learner.run.folder import RunFolder
from learner.trainer import Trainer
from tests.learner.runs import PPO, episodes, small_config, train_some
from tests.transitions import random_transitions

CPU = torch.device("cpu")
IMITATING = {"cloning": {"updates": 6}, "sac": {"privileged_critic": True}, "reward": {"kind": "potential"}}


@pytest.mark.parametrize("changes", [{}, IMITATING, PPO], ids=["sac", "imitation", "ppo"])
def test_a_prepared_batch_teaches_the_same(changes) -> None:
    config = small_config(**changes)
    plain, ahead = make_learner(config, CPU), make_learner(config, CPU)
    for seed in range(3):
        batch = random_transitions(np.random.default_rng(seed), 8, labelled=1.0)
        prepared = ahead.prepare(batch, ahead._rng, cloning=ahead.stage == "cloning")
        assert prepared.graphs is not None
        assert plain.update(batch) == ahead.update(prepared)


def test_a_run_that_prepares_ahead_goes_from_imitation_to_reinforcement(tmp_path) -> None:
    with RunFolder.create(tmp_path, small_config(**IMITATING)) as run:
        algorithm = make_learner(run.config, CPU)
        trainer = Trainer(run, algorithm, lambda _: None, prepare=algorithm.prepare)
        trainer.begin()
        for delivery in episodes(8, labelled=True):
            trainer.ingest.store(delivery)
        figures = train_some(trainer, 12)
        trainer.close()
    assert all("loss/critic" not in of for of in figures[:6]) and all("loss/critic" in of for of in figures[6:])
    assert all(np.isfinite(of["loss/cloning"]) for of in figures[:6])


def test_a_refused_batch_at_the_end_of_imitation_is_followed_by_one_of_the_same_kind(tmp_path) -> None:
    with RunFolder.create(tmp_path, small_config(**IMITATING)) as run:
        algorithm = make_learner(run.config, CPU)
        trainer = Trainer(run, algorithm, lambda _: None)
        trainer.begin()
        for delivery in episodes(8, labelled=True):
            trainer.ingest.store(delivery)
        with Prefetch(trainer.replay, run.config, algorithm.prepare) as batches:
            kinds = [batches.next(updates).graphs.after is not None for updates in (4, 5, 5, 6)]
        trainer.close()
    assert kinds == [False, False, False, True]
