"""The learned baselines are trained by the algorithms that train everything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from common.config import RunConfig
from common.config.load import load_config
from common.observations.observation import ObservationBatch
from common.policies.policy import Policy
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.factory import make_learner
from tests.observations import random_observation
from tests.transitions import random_transitions

CPU = torch.device("cpu")
BASELINES = ("ariadne", "ca", "cnn")
PPO = ["algorithm=ppo", "reward.kind=potential", "ppo.value_only_updates=0"]


def config(preset: str, *overrides: str) -> RunConfig:
    small = ["network.width=16", "network.heads=2", "network.layers=1"]
    small += ["learner.precision=fp32", "adam.policy=0.01"]
    return load_config(overrides=[*small, *overrides], preset=preset)


def batch(preset: str, seed: int = 0, labelled: float = 0.0) -> TransitionBatch:
    return random_transitions(np.random.default_rng(seed), 8, (2, 15), labelled=labelled, image=preset == "cnn")


@pytest.mark.parametrize("preset", BASELINES)
def test_an_update_trains_everything_and_changes_the_decision(preset: str) -> None:
    learner = make_learner(config(preset), CPU)
    before, _ = learner.state()
    metrics = learner.update(batch(preset))
    after, _ = learner.state()
    assert all(np.isfinite(value) for value in metrics.values())
    assert "loss/contrastive" not in metrics
    for module in ("policy", "critic"):
        names = {name for name in before if name.startswith(f"{module}/")}
        assert {name for name in names if not torch.equal(before[name], after[name])} == names
    # The state is exact: another learner that takes it over makes the same next update.
    other = make_learner(config(preset, "seed=9"), CPU)
    other.restore(*learner.state())
    assert learner.update(batch(preset, 1)) == other.update(batch(preset, 1))


@pytest.mark.parametrize("preset", BASELINES)
def test_what_earns_more_becomes_more_likely(preset: str) -> None:
    """Each waypoint of one observation ends the episode, one of them with a reward."""
    learner = make_learner(config(preset, "adam.critic=0.01", "learner.augment=false"), CPU)
    rng = np.random.default_rng(3)
    observation = random_observation(rng, 25, edge_share=1.0, image=preset == "cnn")
    waypoints = observation.waypoint_nodes()
    count, best = len(waypoints), 2
    beacon = observation.beacon_nodes()[0]
    transitions = replace(
        random_transitions(rng, count, (2, 3), image=preset == "cnn"),
        observations=ObservationBatch.stack([observation] * count),
        beacons=np.full(count, beacon, dtype=np.int32),
        waypoints=waypoints.astype(np.int32),
        rewards=np.where(np.arange(count) == best, 2.0, -2.0).astype(np.float32),
        terminal=np.ones(count, dtype=np.bool_),
        next_valid=np.ones(count, dtype=np.bool_),
    )

    def probability() -> float:
        policy = Policy(learner.config.network, learner.policy_weights(averaged=False))
        return float(policy.decide(observation, greedy=True, rng=rng).waypoint_probabilities[best])

    before = probability()
    for _ in range(25):
        learner.update(transitions)
    assert probability() > max(2.0 * before, 0.5)


@pytest.mark.parametrize("preset", BASELINES)
def test_on_policy_returns_and_imitation_train_them_too(preset: str) -> None:
    learner = make_learner(config(preset, *PPO, "cloning.updates=1"), CPU)
    for seed, stage in enumerate(("cloning", "ppo")):
        assert learner.stage == stage
        before, _ = learner.state()
        learner.update(batch(preset, seed, labelled=1.0))
        after, _ = learner.state()
        assert any(not torch.equal(before[name], after[name]) for name in before if name.startswith("policy/"))
