"""The learner: what each stage trains, reproducibility, and that it learns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from common.config import RunConfig
from common.errors import ConfigError
from common.network.graph_batch import GraphBatch
from learner.algorithm.base import NotFiniteError
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.device import choose_device
from learner.algorithm.losses import waypoint_marginal
from learner.algorithm.sac import SacLearner
from tests.transitions import random_transitions

CPU = torch.device("cpu")


def config(**changes: object) -> RunConfig:
    tree: dict[str, object] = {
        "network": {"width": 16, "heads": 2, "layers": 1, "variant": "hdplanner"},
        "learner": {"total_updates": 100},
        "sac": {"target_interval": 3},
    }
    for section, values in changes.items():
        tree[section] = {**tree.get(section, {}), **values} if isinstance(values, dict) else values  # type: ignore[dict-item]
    return RunConfig.model_validate(tree)


def batches(seed: int, count: int, labelled: float = 0.0) -> list[TransitionBatch]:
    rng = np.random.default_rng(seed)
    return [random_transitions(rng, 6, (2, 15), labelled=labelled) for _ in range(count)]


def moved(before: dict[str, torch.Tensor], after: dict[str, torch.Tensor]) -> set[str]:
    """Modules with a weight that changed."""
    return {name.split("/")[0] for name in before if not torch.equal(before[name], after[name])}


@pytest.mark.parametrize("variant", ["vanilla", "hierarchical", "hdplanner"])
def test_an_update_trains_policy_critics_and_temperatures(variant: str) -> None:
    learner = SacLearner(config(network={"variant": variant}), CPU)
    before, _ = learner.state()
    metrics = learner.update(batches(0, 1)[0])
    after, _ = learner.state()
    assert moved(before, after) == {"policy", "critic", "average", "temperatures"}
    assert all(np.isfinite(value) for value in metrics.values())
    assert ("loss/contrastive" in metrics) == (variant == "hdplanner")
    learned = {name for name in before if name.startswith("policy/") and not torch.equal(before[name], after[name])}
    assert learned == {name for name in before if name.startswith("policy/")}


def test_stages_follow_one_another() -> None:
    learner = SacLearner(config(cloning={"updates": 2}, sac={"critic_only_updates": 2}), CPU)
    seen = []
    for batch in batches(1, 6, labelled=1.0):
        before, _ = learner.state()
        stage = learner.stage
        learner.update(batch)
        after, _ = learner.state()
        seen.append((stage, moved(before, after) & {"policy", "critic", "temperatures"}))
    assert seen[:2] == [("cloning", {"policy"})] * 2
    assert seen[2:4] == [("critic", {"critic"})] * 2
    assert seen[4:] == [("sac", {"policy", "critic", "temperatures"})] * 2


def test_targets_are_copied_every_interval() -> None:
    learner = SacLearner(config(), CPU)
    for step, batch in enumerate(batches(2, 4), start=1):
        before, _ = learner.state()
        learner.update(batch)
        after, _ = learner.state()
        assert ("target" in moved(before, after)) == (step == 3)
    soft = SacLearner(config(sac={"target_update": "soft"}), CPU)
    before, _ = soft.state()
    soft.update(batches(2, 1)[0])
    assert "target" in moved(before, soft.state()[0])


def test_same_seed_same_weights() -> None:
    runs = []
    for _ in range(2):
        learner = SacLearner(config(seed=5), CPU)
        for batch in batches(3, 3, labelled=0.5):
            learner.update(batch)
        runs.append(learner.policy_weights(averaged=False))
    assert all(np.array_equal(runs[0][name], runs[1][name]) for name in runs[0])
    other = SacLearner(config(seed=6), CPU).policy_weights(averaged=False)
    assert any(not np.array_equal(runs[0][name], other[name]) for name in other)


def test_imitation_learns_the_cheap_waypoints() -> None:
    setting = config(cloning={"updates": 1000, "learning_rate": 3e-3})
    learner = SacLearner(setting, CPU)
    batch = batches(6, 1, labelled=1.0)[0]
    costs = [learner.update(batch)["cloning/expected_cost"] for _ in range(20)]
    assert costs[-1] < 0.5 * costs[0]


def test_critics_learn_the_reward_of_terminal_transitions() -> None:
    setting = config(adam={"critic": 3e-3}, learner={"augment": False})
    learner = SacLearner(setting, CPU)
    batch = replace(batches(7, 1)[0], terminal=np.ones(6, np.bool_), next_valid=np.ones(6, np.bool_))
    losses = [learner.update(batch)["loss/critic"] for _ in range(20)]
    assert losses[-1] < 0.1 * losses[0]


def test_unknown_successors_serve_imitation_alone() -> None:
    learner = SacLearner(config(), CPU)
    batch = batches(8, 1)[0]
    dead = replace(batch, terminal=np.zeros(6, np.bool_), next_valid=np.zeros(6, np.bool_))
    assert learner.update(dead)["loss/critic"] == 0.0


def test_the_average_follows_the_policy() -> None:
    learner = SacLearner(config(), CPU)
    start = learner.policy_weights(averaged=True)
    for batch in batches(9, 3):
        learner.update(batch)
    newest, average = learner.policy_weights(averaged=False), learner.policy_weights(averaged=True)
    name = "encoder.embedding.weight"
    assert 0 < np.abs(average[name] - start[name]).sum() < np.abs(newest[name] - start[name]).sum()
    off = SacLearner(config(learner={"average_decay": 0.0}), CPU)
    off.update(batches(9, 1)[0])
    assert np.array_equal(off.policy_weights(averaged=True)[name], off.policy_weights(averaged=False)[name])


def test_bf16_updates_stay_finite() -> None:
    learner = SacLearner(config(learner={"precision": "bf16"}), CPU)
    assert all(np.isfinite(value) for value in learner.update(batches(10, 1, labelled=1.0)[0]).values())


def test_devices() -> None:
    assert choose_device("cpu") == CPU
    with pytest.raises(ConfigError, match="expected auto"):
        choose_device("gpu")
    if not torch.cuda.is_available():
        with pytest.raises(ConfigError, match="no CUDA"):
            choose_device("cuda:1")


PRIVILEGED = {"sac": {"privileged_critic": True}, "reward": {"kind": "potential"}}


def test_a_privileged_critic_begins_with_the_experts_view() -> None:
    """With networks that say 0, the policy already descends what the expert tells, whatever the rewards were."""
    setting = config(**PRIVILEGED, adam={"policy": 3e-3})
    learner = SacLearner(setting, CPU)
    for head in (learner.critic.first, learner.critic.second):
        torch.nn.init.zeros_(head.value.weight)
        torch.nn.init.zeros_(head.value.bias)
    silent = replace(batches(6, 1, labelled=1.0)[0], terminal=np.zeros(6, np.bool_), next_valid=np.zeros(6, np.bool_))
    before = cheapness(learner, silent)
    for _ in range(20):
        learner.update(silent)
    assert cheapness(learner, silent) < 0.6 * before


def cheapness(learner: SacLearner, batch: TransitionBatch) -> float:
    """Mean over observations of the detour that the policy expects, metres."""
    graphs = GraphBatch.from_observations(batch.observations, learner.config.network)
    assert batch.labels is not None
    with torch.no_grad():
        output = learner.policy(graphs)
        chance = waypoint_marginal(output.log_waypoint.exp(), output, graphs)
    return float((chance * torch.from_numpy(batch.labels.cost)).sum()) / len(batch)


def test_a_privileged_critic_learns_only_what_is_not_told() -> None:
    """Where the reward is what the expert said and nothing follows, nothing is left to learn."""
    setting = config(**PRIVILEGED, learner={"augment": False})
    batch = batches(7, 1, labelled=1.0)[0]
    assert batch.labels is not None
    sizes = [len(batch.observations[k].waypoint_nodes()) for k in range(6)]
    first = np.cumsum([0, *sizes[:-1]])
    slot = [list(batch.observations[k].waypoint_nodes()).index(batch.waypoints[k]) for k in range(6)]
    told = -np.minimum(batch.labels.cost[first + slot], 40.0) / 4.0
    ended = replace(batch, rewards=told.astype(np.float32), terminal=np.ones(6, np.bool_))
    learner = SacLearner(setting, CPU)
    for head in (learner.critic.first, learner.critic.second):
        torch.nn.init.zeros_(head.value.weight)
        torch.nn.init.zeros_(head.value.bias)
    assert learner.update(ended)["loss/critic"] < 1e-9
    assert SacLearner(config(learner={"augment": False}), CPU).update(ended)["loss/critic"] > 0.1


def test_a_privileged_critic_refuses_steps_without_labels() -> None:
    learner = SacLearner(config(**PRIVILEGED), CPU)
    with pytest.raises(ValueError, match="labelled transitions"):
        learner.update(batches(8, 1)[0])


def test_a_privileged_critic_needs_the_potential_reward() -> None:
    with pytest.raises(ValueError, match="set reward.kind to 'potential'"):
        config(sac={"privileged_critic": True})


def poisoned(batch: TransitionBatch, rows: list[int]) -> TransitionBatch:
    rewards = batch.rewards.copy()
    rewards[rows] = np.float32(np.inf)
    return replace(batch, rewards=rewards, next_valid=np.ones(len(batch), dtype=np.bool_))


@pytest.mark.parametrize("rows", [[0], [5], [1, 4]])
def test_an_update_that_is_not_finite_changes_nothing_and_names_the_rows(rows: list[int]) -> None:
    learner = SacLearner(config(), CPU)
    good, bad = batches(30, 2)
    learner.update(good)
    before, values = learner.state()
    with pytest.raises(NotFiniteError, match="loss/critic.*not finite") as caught:
        learner.update(poisoned(bad, rows))
    assert caught.value.culprits.tolist() == rows
    after, later = learner.state()
    assert moved(before, after) == set()
    assert all(torch.equal(before[name], after[name]) for name in before)
    assert later["updates"] == values["updates"]
    assert all(np.isfinite(value) for value in learner.update(bad).values())


def test_weights_that_have_diverged_are_no_fault_of_the_data() -> None:
    learner = SacLearner(config(), CPU)
    with torch.no_grad():
        next(iter(learner.critic.parameters())).fill_(float("nan"))
    with pytest.raises(NotFiniteError) as caught:
        learner.update(batches(31, 1)[0])
    assert len(caught.value.culprits) == 0


def test_a_batch_without_a_known_successor_is_no_divergence() -> None:
    learner = SacLearner(config(), CPU)
    batch = batches(32, 1)[0]
    alone = replace(batch, next_valid=np.zeros(6, dtype=np.bool_), terminal=np.zeros(6, dtype=np.bool_))
    assert learner.update(alone)["loss/critic"] == 0.0
