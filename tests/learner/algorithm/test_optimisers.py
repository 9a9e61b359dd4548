"""Schedules of the learning rate, and weights that follow others."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from common.config import AdamConfig
from common.errors import CheckpointError
from learner.algorithm.optimisers import Optimiser, blend, scheduled_rate


@pytest.mark.parametrize(
    ("schedule", "middle", "end"), [("constant", 1.0, 1.0), ("linear", 0.6, 0.2), ("cosine", 0.6, 0.2)]
)
def test_schedules(schedule: str, middle: float, end: float) -> None:
    config = AdamConfig.model_validate({"schedule": schedule, "warmup_updates": 10, "final_fraction": 0.2})
    assert scheduled_rate(2.0, 4, 110, config) == pytest.approx(1.0)
    assert scheduled_rate(2.0, 10, 110, config) == pytest.approx(2.0)
    assert scheduled_rate(2.0, 60, 110, config) == pytest.approx(2.0 * middle)
    assert scheduled_rate(2.0, 110, 110, config) == pytest.approx(2.0 * end)
    assert scheduled_rate(2.0, 500, 110, config) == pytest.approx(2.0 * end)


def test_clipping_bounds_the_gradient_and_reports_the_whole() -> None:
    module = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(module.weight)
    optimiser = Optimiser(module, 0.5)
    norm = optimiser.prepare(module(torch.tensor([[8.0]])).sum(), 0.1)
    assert norm.item() == pytest.approx(8.0)
    assert module.weight.item() == 0.0
    optimiser.apply()
    optimiser.apply()
    assert module.weight.grad is not None
    assert module.weight.grad.item() == pytest.approx(0.5, rel=1e-4)
    assert module.weight.item() == pytest.approx(-0.1, rel=1e-4)


def test_steps_are_those_of_the_class_also_after_a_restart() -> None:
    torch.manual_seed(0)
    module, other = nn.Linear(3, 2), nn.Linear(3, 2)
    other.load_state_dict(module.state_dict())
    optimiser, reference = Optimiser(module, None), torch.optim.Adam(other.parameters())
    for step in range(6):
        batch, rate = torch.randn(4, 3), 0.1 / (step + 1)
        optimiser.prepare(module(batch).square().sum(), rate)
        optimiser.apply()
        reference.zero_grad()
        other(batch).square().sum().backward()
        reference.param_groups[0]["lr"] = rate
        reference.step()
        state = optimiser.state()
        optimiser = Optimiser(module, None)
        optimiser.restore(state)
    assert torch.equal(module.weight, other.weight) and torch.equal(module.bias, other.bias)
    assert set(state) == {f"{name}.{key}" for name in ("weight", "bias") for key in ("step", "exp_avg", "exp_avg_sq")}


def test_a_foreign_state_is_refused() -> None:
    optimiser = Optimiser(nn.Linear(2, 2), None)
    with pytest.raises(CheckpointError, match=r"other\.exp_avg"):
        optimiser.restore({"other.exp_avg": torch.zeros(2)})


def test_blend() -> None:
    values, goals = [torch.zeros(2)], [torch.ones(2)]
    blend(goals, values, 0.25)
    assert values[0].tolist() == [0.25, 0.25]
    blend(goals, values, 1.0)
    assert values[0].tolist() == [1.0, 1.0]
