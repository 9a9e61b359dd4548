"""On-policy returns on top of the exact sum: the loss by hand, who gets a gradient, scales."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from common.config import RunConfig
from common.network.graph_batch import GraphBatch
from learner.algorithm.base import NotFiniteError
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.cloning import cloning_loss
from learner.algorithm.factory import make_learner
from learner.algorithm.losses import clipped_surrogate, waypoint_marginal
from learner.algorithm.ppo import PpoLearner
from learner.algorithm.sac import SacLearner
from learner.algorithm.sample import Sample
from learner.algorithm.teachers import Teachers
from learner.algorithm.value import VALUE_FEATURES, FamilyScales, value_features
from tests.learner.algorithm.test_sac import CPU, batches, config, moved
from tests.transitions import random_transitions

PPO = {"algorithm": "ppo", "reward": {"kind": "potential"}}


def ppo_config(ppo: dict[str, object] | None = None, **changes: object) -> RunConfig:
    return config(**PPO, **changes, ppo={"value_only_updates": 0} | (ppo or {}))


def known(seed: int, size: int = 6) -> TransitionBatch:
    """Labelled transitions that lead to labelled states and continue."""
    batch = random_transitions(np.random.default_rng(seed), size, (2, 15), labelled=1.0)
    return replace(batch, terminal=np.zeros(size, np.bool_), next_valid=np.ones(size, np.bool_))


def chances(learner: PpoLearner, batch: TransitionBatch) -> list[np.ndarray]:
    """Probability of each waypoint of each observation under the present policy."""
    graphs = GraphBatch.from_observations(batch.observations, learner.config.network)
    with torch.no_grad():
        output = learner.policy(graphs)
        marginal = waypoint_marginal(output.log_waypoint.exp(), output, graphs).numpy()
    return np.split(marginal, graphs.arrays.waypoint_ptr[1:-1])


def chosen(batch: TransitionBatch) -> list[int]:
    """Place of the chosen waypoint among those of its observation."""
    return [
        int(np.flatnonzero(batch.observations[k].waypoint_nodes() == batch.waypoints[k])[0]) for k in range(len(batch))
    ]


def test_a_run_gets_the_algorithm_that_it_asks_for() -> None:
    assert isinstance(make_learner(config(), CPU), SacLearner)
    assert isinstance(make_learner(ppo_config(), CPU), PpoLearner)
    assert ppo_config().labelled
    with pytest.raises(ValueError, match="set reward.kind to 'potential'"):
        config(algorithm="ppo")


@pytest.mark.parametrize("variant", ["vanilla", "hierarchical", "hdplanner"])
def test_stages_follow_one_another(variant: str) -> None:
    setting = ppo_config(network={"variant": variant}, cloning={"updates": 1}, ppo={"value_only_updates": 1})
    learner = PpoLearner(setting, CPU)
    seen = []
    for batch in batches(1, 3, labelled=1.0):
        before, _ = learner.state()
        stage = learner.stage
        metrics = learner.update(batch)
        after, _ = learner.state()
        assert all(np.isfinite(value) for value in metrics.values())
        seen.append((stage, {name for name in moved(before, after) if not name.startswith("optimiser")}))
    assert seen == [
        ("cloning", {"policy", "average"}),
        ("value", {"value"}),
        ("ppo", {"policy", "average", "value", "scales"}),
    ]
    assert ("loss/contrastive" in metrics) == (variant == "hdplanner")


def test_the_clipped_loss_by_hand() -> None:
    log_ratio = torch.tensor([0.0, 0.5, 0.5, -0.5, -0.5], requires_grad=True)
    advantage = torch.tensor([1.0, 2.0, -2.0, 3.0, -3.0])
    loss = clipped_surrogate(log_ratio, advantage, 0.2)
    up, down = np.exp(0.5), np.exp(-0.5)
    assert loss.item() == pytest.approx(-(1.0 + 2.0 * 1.2 - 2.0 * up + 3.0 * down - 3.0 * 0.8) / 5)
    (gradient,) = torch.autograd.grad(loss, log_ratio)
    assert gradient.numpy() == pytest.approx([-0.2, 0.0, 2.0 * up / 5, -3.0 * down / 5, 0.0], abs=1e-6)


def test_the_loss_of_an_update_by_hand() -> None:
    """With V = 0 the advantage is the return, so all can be worked out from batch and policy."""
    setting = ppo_config(
        contrastive={"weight": 0.0}, learner={"augment": False}, ppo={"imitation_weight": 0.7, "scale_rate": 1.0}
    )
    learner = PpoLearner(setting, CPU)
    batch = known(2)
    batch = replace(
        batch,
        families=np.zeros(6, dtype=np.uint8),
        probabilities=np.array([0.5, 0.4, 0.3, 0.2, 0.1, 0.0], dtype=np.float32),
    )
    assert batch.labels is not None
    sample = Sample.make(batch, setting, CPU, bootstrap=False, teachers=Teachers(setting))
    assert sample.guidance is not None
    imitation = cloning_loss(learner.policy(sample.now), sample.guidance, sample.now, setting.cloning).total.item()
    per_state = chances(learner, batch)
    costs = np.split(np.minimum(batch.labels.cost, 40.0) / 4.0, np.cumsum([len(p) for p in per_state])[:-1])
    rest, ratio, expected = [], [], []
    for k, slot in enumerate(chosen(batch)[:5]):  # the last was no choice of the policy
        rest.append(batch.rewards[k] + costs[k][slot] - per_state[k] @ costs[k])
        ratio.append(per_state[k][slot] / batch.probabilities[k])
        expected.append(per_state[k] @ costs[k])
    size = np.std(rest)
    scaled = np.clip((np.array(rest) - np.mean(rest)) / size, -4.0, 4.0)
    surrogate = -np.minimum(np.array(ratio) * scaled, np.clip(ratio, 0.8, 1.2) * scaled).mean()
    metrics = learner.update(batch)
    assert metrics["advantage/size_0"] == pytest.approx(size, rel=1e-4)
    assert metrics["loss/surrogate"] == pytest.approx(surrogate, rel=1e-4)
    exact = np.mean(expected) / size
    assert metrics["loss/exact"] == pytest.approx(exact, rel=1e-4)
    assert metrics["loss/policy"] == pytest.approx(0.7 * imitation + exact + surrogate, rel=1e-4)
    target = batch.rewards[:5]
    loss = np.where(np.abs(target) <= 4.0, 0.5 * target**2, 4.0 * (np.abs(target) - 2.0)).mean()
    assert metrics["loss/value"] == pytest.approx(loss, rel=1e-4)


@pytest.mark.parametrize("why", ["nobody drew", "time limit", "actor died"])
def test_steps_without_a_return_serve_imitation_alone(why: str) -> None:
    learner, batch = PpoLearner(ppo_config(), CPU), known(3)
    none = np.zeros(6, np.bool_)
    batch = {
        "nobody drew": replace(batch, probabilities=np.zeros(6, np.float32)),
        "time limit": replace(batch, next_labelled=none),
        "actor died": replace(batch, next_valid=none),
    }[why]
    before, _ = learner.state()
    metrics = learner.update(batch)
    assert moved(before, learner.state()[0]) == {"policy", "average"}
    assert "loss/surrogate" not in metrics and metrics["loss/cloning"] > 0.0


def test_the_end_of_the_task_needs_no_labels_and_nothing_comes_after_it() -> None:
    learner = PpoLearner(ppo_config(), CPU)
    torch.nn.init.constant_(learner.value.layers[-1].bias, 5.0)  # type: ignore[arg-type]
    batch = replace(known(4), terminal=np.ones(6, np.bool_), next_labelled=np.zeros(6, np.bool_))
    assert learner.update(batch)["value/target"] == pytest.approx(batch.rewards.mean(), abs=1e-5)


def test_a_good_waypoint_becomes_more_likely() -> None:
    """Where the expert sees no difference, returns alone decide."""
    setting = ppo_config(
        adam={"policy": 3e-3},
        learner={"augment": False},
        cloning={"cross_entropy_weight": 0.0, "beacon_weight": 0.0, "entropy_bonus": 0.0},
        contrastive={"weight": 0.0},
    )
    learner, batch = PpoLearner(setting, CPU), known(5)
    assert batch.labels is not None
    # Of one family: advantages count from its mean.
    batch = replace(batch, families=np.zeros(6, dtype=np.uint8))
    batch = replace(batch, labels=replace(batch.labels, cost=np.zeros_like(batch.labels.cost)))
    rewards = np.where(np.arange(6) % 2 == 0, 2.0, -2.0).astype(np.float32)
    before = np.array([p[s] for p, s in zip(chances(learner, batch), chosen(batch), strict=True)])
    batch = replace(batch, rewards=rewards, discounts=np.zeros(6, np.float32), probabilities=before)
    for _ in range(3):
        learner.update(batch)
    after = np.array([p[s] for p, s in zip(chances(learner, batch), chosen(batch), strict=True)])
    gained = np.log(after / before)
    assert gained[rewards > 0.0].mean() > 0.02 and gained[rewards < 0.0].mean() < -0.02


def test_only_what_serves_imitation_is_turned() -> None:
    learner, batch = PpoLearner(ppo_config(), CPU), known(6, 40)
    probabilities = np.where(np.arange(40) < 20, 0.5, 0.0).astype(np.float32)
    batch = replace(batch, probabilities=probabilities)
    turned = learner.prepare(batch, np.random.default_rng(0), cloning=False).observations
    same = [np.array_equal(turned[k].offsets, batch.observations[k].offsets) for k in range(40)]
    assert all(same[:20]) and not all(same[20:])


def test_returns_need_labels() -> None:
    with pytest.raises(ValueError, match="labelled transitions"):
        PpoLearner(ppo_config(), CPU).update(batches(8, 1)[0])


def test_each_family_has_its_own_mean_and_size() -> None:
    scales = FamilyScales(rate=0.01)
    rng = np.random.default_rng(0)
    for _ in range(100):
        family = torch.from_numpy(rng.integers(2, size=20))
        drawn = torch.from_numpy(rng.normal(size=20).astype(np.float32))
        scales.add(torch.where(family == 1, 10.0 * drawn - 30.0, drawn), family)
    mean, size = scales.usual()
    assert mean[:3].numpy() == pytest.approx([0.0, -30.0, 0.0], abs=3.0)
    assert size[:3].numpy() == pytest.approx([1.0, 10.0, FamilyScales.LEAST], rel=0.2)
    once = FamilyScales(rate=0.01)
    once.add(torch.tensor([3.0, 5.0]), torch.tensor([7, 7]))
    assert [float(value[7]) for value in once.usual()] == pytest.approx([4.0, 1.0], rel=1e-4)


def test_value_features_are_bounded_and_do_not_turn_with_the_world() -> None:
    learner = PpoLearner(ppo_config(), CPU)
    batch = replace(known(7, 12), probabilities=np.zeros(12, np.float32))
    assert batch.labels is not None
    features = value_features(batch.observations, batch.labels, learner.config)
    assert features.shape == (12, VALUE_FEATURES) and features.min() >= 0.0 and features.max() <= 1.0
    turned = learner.prepare(batch, np.random.default_rng(0), cloning=False)
    assert np.array_equal(value_features(turned.observations, batch.labels, learner.config), features)
    far = replace(batch.labels, remaining=np.full(12, 1e6, np.float32), unseen=np.full(12, 1e9, np.float32))
    assert value_features(batch.observations, far, learner.config).max() <= 1.0
    costs = np.split(
        np.minimum(batch.labels.cost / 40.0, 1.0), np.cumsum([len(p) for p in chances(learner, batch)])[:-1]
    )
    assert features[:, 10] == pytest.approx([np.sort(c)[1] if len(c) > 1 else 0.0 for c in costs], abs=1e-6)
    assert features[:, 11] == pytest.approx([c.mean() for c in costs], abs=1e-6)


def test_the_value_function_learns() -> None:
    learner = PpoLearner(ppo_config(ppo={"value_only_updates": 1000, "value": 1e-2, "clip_norm": 100.0}), CPU)
    batch = replace(known(9, 8), discounts=np.zeros(8, np.float32))
    losses = [learner.update(batch)["loss/value"] for _ in range(150)]
    assert losses[-1] < 0.1 * losses[0]


def test_an_update_that_is_not_finite_leaves_weights_and_scales_alone() -> None:
    learner = PpoLearner(ppo_config(), CPU)
    learner.update(known(20))
    before, _ = learner.state()
    bad = known(21)
    rewards = bad.rewards.copy()
    rewards[2] = np.float32(np.nan)
    with pytest.raises(NotFiniteError) as caught:
        learner.update(replace(bad, rewards=rewards))
    assert caught.value.culprits.tolist() == [2]
    after, _ = learner.state()
    assert all(torch.equal(before[name], after[name]) for name in before)
    learner.update(bad)
