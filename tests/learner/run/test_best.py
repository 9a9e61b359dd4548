"""The best policy: evaluations are compared with those in the same worlds alone; published policies wait for theirs."""

import numpy as np

from learner.rate_limiter import RateLimiter
from learner.run.best import BestPolicy, PublishedPolicies
from learner.run.cards import PolicyCards
from learner.run.checkpoints import CheckpointStore
from learner.run.evaluation import Round, validation_of
from learner.run.export import export_policy
from learner.run.folder import RunFolder
from tests.learner.experience import episode_report
from tests.learner.runs import small_config


def best_policy(folder, config):
    cards = PolicyCards(config, RateLimiter(1.0, 1, 1))
    return BestPolicy(CheckpointStore(folder, 2), cards.describe, validation_of(config))


def consider(best, version, distance):
    best.remember(version, version, {"weight": np.zeros(2, np.float32)}, set())
    best.consider(Round.of(version, [episode_report("evaluate", version, distance=distance)]))
    return best.version


def test_an_evaluation_in_other_worlds_is_not_compared(tmp_path, caplog):
    small = small_config(maps={"validation": ["generator:rooms?width=192&height=192"]})
    large = small_config(maps={"validation": ["generator:building"]})
    with RunFolder.create(tmp_path, small) as run:
        best = best_policy(run.checkpoints, small)
        assert consider(best, 1, 30.0) == 1 and consider(best, 2, 40.0) == 1
        again = best_policy(run.checkpoints, small)
        assert consider(again, 3, 35.0) == 1
        other = best_policy(run.checkpoints, large)
        assert other.version == 1
        assert "evaluated with another worlds.worlds.exploration" in caplog.text
        assert consider(other, 4, 300.0) == 4 and consider(other, 5, 310.0) == 4
        assert best_policy(run.checkpoints, large).version == 4
        card = export_policy(run.path, "best", tmp_path / "best.safetensors")
        assert card.version == 4 and card.evaluation["distance"] == 300.0


def test_policies_under_evaluation_outlive_the_others():
    policies = PublishedPolicies(keep=2)
    for version in range(1, 7):
        policies.add(version, version * 10, {}, pinned={2})
    assert [version for version in range(1, 7) if policies.get(version)] == [2, 5, 6]
