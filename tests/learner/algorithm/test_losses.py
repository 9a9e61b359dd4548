"""Every loss against numbers worked by hand.

The world of most tests: one observation with two beacons and two waypoints, π_b = (0.25, 0.75),
π_a(. | b₀) = (0.5, 0.5), π_a(. | b₁) = (0.2, 0.8), and Q = ((1, 2), (3, 4)); the joint is (.125, .125, .15, .6).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from common.config import CloningConfig, NetworkConfig
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyOutput
from common.observations.observation import Observation, ObservationBatch
from learner.algorithm.cloning import Guidance, cloning_loss
from learner.algorithm.losses import (
    critic_loss,
    critic_target,
    entropies,
    policy_loss,
    soft_value,
    temperature_loss,
    waypoint_marginal,
)

JOINT = np.array([0.125, 0.125, 0.15, 0.6])
Q = torch.tensor([1.0, 2.0, 3.0, 4.0])


def line(beacons: tuple[bool, bool, bool]) -> Observation:
    """Three viewpoints in a row, the robot in the middle, each linked to the next."""
    return Observation(
        offsets=np.array([[-64, 0], [0, 0], [64, 0]], dtype=np.int16),
        utility=np.array([3, 0, 3], dtype=np.uint16),
        visited=np.zeros(3, dtype=np.bool_),
        beacon=np.array(beacons),
        degree=np.array([1, 1, 0], dtype=np.uint8),
        neighbours=np.array([1, 2], dtype=np.uint16),
        bent=np.zeros(0, dtype=np.uint32),
        bent_length=np.zeros(0, dtype=np.float32),
        robot=1,
        has_target=False,
        target_known=False,
        target_offset=np.zeros(2, dtype=np.float32),
        target_links=np.zeros(0, dtype=np.uint16),
        cell=0.0625,
        reach=5.0,
        route=np.zeros(0, dtype=np.uint16),
    )


@pytest.fixture
def batch() -> GraphBatch:
    return GraphBatch.from_observations(ObservationBatch.stack([line((True, False, True))]), NetworkConfig())


@pytest.fixture
def output() -> PolicyOutput:
    return PolicyOutput(
        log_beacon=torch.tensor([0.25, 0.75]).log().requires_grad_(),
        log_waypoint=torch.tensor([0.5, 0.5, 0.2, 0.8]).log().requires_grad_(),
        beacon_features=None,
        waypoint_features=torch.zeros(2, 4),
    )


def test_soft_value_is_the_exact_sum(batch: GraphBatch, output: PolicyOutput) -> None:
    alpha_beacon, alpha_waypoint = torch.tensor(0.1), torch.tensor(0.2)
    of_q = float(JOINT @ [1, 2, 3, 4])  # 0.125 + 0.25 + 0.45 + 2.4 = 3.225
    beacon_entropy = -(0.25 * math.log(0.25) + 0.75 * math.log(0.75))
    waypoint_entropy = 0.25 * math.log(2) - 0.75 * (0.2 * math.log(0.2) + 0.8 * math.log(0.8))
    expected = of_q + 0.1 * beacon_entropy + 0.2 * waypoint_entropy
    assert of_q == pytest.approx(3.225)
    value = soft_value(output, Q, alpha_beacon, alpha_waypoint, batch)
    assert value.tolist() == pytest.approx([expected], rel=1e-5)
    assert policy_loss(output, Q, alpha_beacon, alpha_waypoint, batch).item() == pytest.approx(-expected, rel=1e-5)
    found = entropies(output, batch)
    assert [h.item() for h in found] == pytest.approx([beacon_entropy, waypoint_entropy], rel=1e-5)


def test_marginal_weighs_with_the_beacons(batch: GraphBatch, output: PolicyOutput) -> None:
    # a0: 0.25 * 1 + 0.75 * 3 = 2.5; a1: 0.25 * 2 + 0.75 * 4 = 3.5
    assert waypoint_marginal(Q, output, batch).tolist() == pytest.approx([2.5, 3.5])


def test_an_end_state_without_choices_is_worth_nothing() -> None:
    batch = GraphBatch.from_observations(
        ObservationBatch.stack([line((False, False, False)), line((True, False, False))]), NetworkConfig()
    )
    output = PolicyOutput(torch.zeros(1), torch.tensor([0.5, 0.5]).log(), None, torch.zeros(4, 4))
    value = soft_value(output, torch.tensor([2.0, 4.0]), torch.tensor(0.0), torch.tensor(0.0), batch)
    assert value.tolist() == pytest.approx([0.0, 3.0])


def test_only_a_terminal_end_cuts_the_bootstrap() -> None:
    target = critic_target(
        torch.tensor([1.0, 1.0]), torch.tensor([True, False]), torch.tensor([10.0, 10.0]), torch.tensor([0.9, 0.9])
    )
    assert target.tolist() == pytest.approx([1.0, 10.0])


def test_critic_loss() -> None:
    q, target = torch.tensor([1.0, 5.0]), torch.tensor([2.0, 2.0])
    assert critic_loss(q, target, None).item() == pytest.approx((1 + 9) / 2)
    # |1| <= 2: 0.5; |3| > 2: 2 (3 - 1) = 4
    assert critic_loss(q, target, 2.0).item() == pytest.approx((0.5 + 4.0) / 2)
    assert critic_loss(q[:0], target[:0], 2.0).item() == 0.0


def test_temperature_leaves_single_choices_out() -> None:
    log_alpha = torch.tensor(math.log(0.5), requires_grad=True)
    entropy, choices = torch.tensor([0.9, 0.0]), torch.tensor([4, 1])
    loss = temperature_loss(log_alpha, entropy, choices, 0.5)
    expected = 0.5 * (0.9 - 0.5 * math.log(4))
    assert loss.item() == pytest.approx(expected, rel=1e-5)
    loss.backward()
    assert log_alpha.grad is not None
    assert log_alpha.grad.item() > 0  # more entropy than wanted: descent lowers the temperature
    nothing = temperature_loss(log_alpha, torch.zeros(1), torch.tensor([1]), 0.5)
    assert nothing.item() == 0.0


def nobody_else() -> tuple[torch.Tensor, torch.Tensor]:
    """No other teacher than the expert."""
    return torch.zeros(2), torch.tensor([False])


def test_another_teacher_stands_in_the_place_of_the_expert(batch: GraphBatch, output: PolicyOutput) -> None:
    wanted, follows = torch.tensor([0.2, 0.8]), torch.tensor([True])
    guidance = Guidance(torch.tensor([0.0, 100.0]), torch.tensor([1]), torch.tensor([True]), wanted, follows)
    loss = cloning_loss(output, guidance, batch, CloningConfig(entropy_bonus=0.0))
    marginal = np.array([0.125 + 0.15, 0.125 + 0.6])
    assert loss.following.item() == pytest.approx(-(np.array([0.2, 0.8]) * np.log(marginal)).sum(), rel=1e-5)
    assert loss.total.item() == pytest.approx(loss.following.item(), rel=1e-6)


def test_cloning_loss(batch: GraphBatch, output: PolicyOutput) -> None:
    config = CloningConfig(
        cost_scale=4.0, max_cost=2.0, cross_entropy_weight=0.1, beacon_weight=0.5, entropy_bonus=0.01
    )
    guidance = Guidance(torch.tensor([0.0, 100.0]), torch.tensor([1]), torch.tensor([True]), *nobody_else())
    loss = cloning_loss(output, guidance, batch, config)
    marginal = np.array([0.125 + 0.15, 0.125 + 0.6])
    wanted = np.exp([0.0, -2.0]) / np.exp([0.0, -2.0]).sum()
    expected_cost = marginal[1] * 2.0
    cross_entropy = -(wanted * np.log(marginal)).sum()
    assert loss.expected_cost.item() == pytest.approx(expected_cost, rel=1e-5)
    assert loss.cross_entropy.item() == pytest.approx(cross_entropy, rel=1e-5)
    assert loss.beacon_cross_entropy.item() == pytest.approx(-math.log(0.75), rel=1e-5)
    entropy = sum(h.item() for h in entropies(output, batch))
    total = expected_cost + 0.1 * cross_entropy - 0.5 * math.log(0.75) - 0.01 * entropy
    assert loss.total.item() == pytest.approx(total, rel=1e-5)


def test_cloning_ignores_what_has_no_label(batch: GraphBatch, output: PolicyOutput) -> None:
    unlabelled = Guidance(torch.tensor([0.0, 9.0]), torch.tensor([-1]), torch.tensor([False]), *nobody_else())
    assert cloning_loss(output, unlabelled, batch, CloningConfig()).total.item() == 0.0
    no_beacon = replace(unlabelled, labelled=torch.tensor([True]))
    assert cloning_loss(output, no_beacon, batch, CloningConfig()).beacon_cross_entropy.item() == 0.0
