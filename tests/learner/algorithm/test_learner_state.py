"""The state of learners: exact resumption, and what does not fit."""

from __future__ import annotations

import json

import pytest
import torch

from common.config import RunConfig
from common.errors import CheckpointError, WeightsError
from learner.algorithm.policy_learner import PolicyLearner
from learner.algorithm.ppo import PpoLearner
from learner.algorithm.sac import SacLearner
from tests.learner.algorithm.test_ppo import ppo_config
from tests.learner.algorithm.test_sac import CPU, batches, config


@pytest.mark.parametrize(
    ("kind", "setting", "count", "labelled"),
    [
        (SacLearner, config(cloning={"updates": 1, "anchor_weight": 0.3}, contrastive={"beacons": True}), 3, 0.5),
        (
            PpoLearner,
            ppo_config(cloning={"updates": 1}, ppo={"value_only_updates": 1}, contrastive={"beacons": True}),
            4,
            1.0,
        ),
    ],
)
def test_resumption_is_exact(
    kind: type[SacLearner] | type[PpoLearner], setting: RunConfig, count: int, labelled: float
) -> None:
    history, future = batches(4, count, labelled=labelled), batches(5, 3, labelled=labelled)
    learner: PolicyLearner = kind(setting, CPU)
    for batch in history:
        learner.update(batch)
    tensors, values = learner.state()
    resumed: PolicyLearner = kind(setting.model_copy(update={"seed": 9}), CPU)
    resumed.restore(tensors, json.loads(json.dumps(values)))
    for batch in future:
        assert learner.update(batch) == resumed.update(batch)
    ours, theirs = learner.state()[0], resumed.state()[0]
    assert set(ours) == set(theirs)
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_state_that_does_not_fit_is_refused() -> None:
    tensors, values = SacLearner(config(), CPU).state()
    with pytest.raises(WeightsError, match="expected shape"):
        SacLearner(config(network={"width": 32}), CPU).restore(tensors, values)
    learner = SacLearner(config(), CPU)
    learner.update(batches(0, 1)[0])
    tensors, values = learner.state()
    with pytest.raises(CheckpointError, match=r"optimiser\.critic"):
        kept = {name: value for name, value in tensors.items() if name != "optimiser.critic/first.value.bias.exp_avg"}
        SacLearner(config(), CPU).restore(kept, values)
    with pytest.raises(CheckpointError, match="target"):
        kept = {name: value for name, value in tensors.items() if not name.startswith("target/")}
        SacLearner(config(), CPU).restore(kept, values)


def test_the_state_of_another_algorithm_is_refused() -> None:
    with pytest.raises(CheckpointError, match=r"scales.*value.*algorithm of the run"):
        PpoLearner(ppo_config(), CPU).restore(*SacLearner(config(), CPU).state())
