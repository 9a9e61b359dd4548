"""The losses of hierarchical soft actor-critic, each a pure function (paper, section IV; docs/design.md).

All are exact sums over the pairs (b, a) of beacon and waypoint of each observation; see `GraphBatch` for slots and
pairs. Observations without a pair (an end state) have value 0.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyOutput
from common.network.segment import segment_logsumexp, segment_sum
from learner.algorithm.whole import mean

_LARGEST_LOG_RATIO = 5.0


def joint_log_probability(output: PolicyOutput, batch: GraphBatch) -> Tensor:
    """Return log π(b, a | o) = log π_b(b | o) + log π_a(a | o, b) of every pair, shape (total pairs,)."""
    return output.log_beacon.index_select(0, batch.pair_beacon) + output.log_waypoint


def waypoint_marginal(values: Tensor, output: PolicyOutput, batch: GraphBatch) -> Tensor:
    """Return Σ_b π_b(b | o) x(b, a) of every waypoint slot, for values x of the pairs, shape (total waypoints,)."""
    weights = output.log_beacon.exp().index_select(0, batch.pair_beacon)
    return segment_sum(weights * values, batch.pair_waypoint, len(batch.waypoint_rows))


def log_marginal(output: PolicyOutput, batch: GraphBatch) -> Tensor:
    """Return log Σ_b π_b(b | o) π_a(a | o, b) of every waypoint slot, shape (total waypoints,)."""
    return segment_logsumexp(joint_log_probability(output, batch), batch.pair_waypoint, len(batch.waypoint_rows))


def soft_value(
    output: PolicyOutput, q: Tensor, alpha_beacon: Tensor, alpha_waypoint: Tensor, batch: GraphBatch
) -> Tensor:
    """V(o) = Σ_b π_b Σ_a π_a [Q(o, b, a) − α_b log π_b − α_a log π_a], shape (k,).

    Args:
        output: the policy on the batch.
        q: min_i Q_i of every pair, shape (total pairs,).
        alpha_beacon: α_b, a scalar.
        alpha_waypoint: α_a, a scalar.
        batch: the observations.
    """
    log_beacon = output.log_beacon.index_select(0, batch.pair_beacon)
    surplus = q - alpha_beacon * log_beacon - alpha_waypoint * output.log_waypoint
    weighted = (log_beacon + output.log_waypoint).exp() * surplus
    return segment_sum(weighted, batch.pair_graph, len(batch))


def critic_target(rewards: Tensor, terminal: Tensor, next_value: Tensor, discounts: Tensor) -> Tensor:
    """Y = r + γ^m (1 − d) V_target(o'), shape (k,); d is 1 at a terminal end alone, a time limit is bootstrapped.

    Of m rewards, r is the discounted sum; the entropies between, which α makes small, are left out of it.
    """
    return rewards + discounts * torch.where(terminal, torch.zeros_like(next_value), next_value)


def critic_loss(q: Tensor, target: Tensor, huber_delta: float | None) -> Tensor:
    """Mean of (Q(o, b, a) − y)² over the transitions, or of its Huber form; 0 for no transition.

    Args:
        q: Q of the chosen pairs, shape (k,).
        target: y, shape (k,), without gradient.
        huber_delta: errors above it count linearly, with the same slope there as delta · |error| (the Huber loss,
            ½ e² near zero); None for the square.
    """
    if huber_delta is None:
        return mean((q - target).square())
    return mean(functional.huber_loss(q, target, reduction="none", delta=huber_delta))


def policy_loss(
    output: PolicyOutput, q: Tensor, alpha_beacon: Tensor, alpha_waypoint: Tensor, batch: GraphBatch
) -> Tensor:
    """J = mean over o of Σ_b π_b Σ_a π_a [α_b log π_b + α_a log π_a − min_i Q_i]; arguments as in `soft_value`."""
    return -mean(soft_value(output, q, alpha_beacon, alpha_waypoint, batch))


def clipped_surrogate(log_ratio: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """Mean of −min(ρ A, clip(ρ, 1 − ε, 1 + ε) A) over the transitions (Schulman et al. 2017, equation 7).

    Args:
        log_ratio: log ρ = log π(a) − log π_behaviour(a), shape (n,), n > 0.
        advantage: A, shape (n,), without gradient.
        clip: ε.
    """
    # A waypoint that has become e^5 times as likely is no longer the one that was judged: its gradient ends there.
    ratio = log_ratio.clamp(-_LARGEST_LOG_RATIO, _LARGEST_LOG_RATIO).exp()
    return -mean(torch.minimum(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage))


def entropies(output: PolicyOutput, batch: GraphBatch) -> tuple[Tensor, Tensor]:
    """Return H_b = −Σ_b π_b log π_b and H_a = −Σ_b π_b Σ_a π_a log π_a of every observation, shape (k,) each."""
    of_beacon = output.log_beacon.exp() * output.log_beacon
    of_waypoint = joint_log_probability(output, batch).exp() * output.log_waypoint
    return (
        -segment_sum(of_beacon, batch.beacon_graph, len(batch)),
        -segment_sum(of_waypoint, batch.pair_graph, len(batch)),
    )


def temperature_loss(log_alpha: Tensor, entropy: Tensor, choices: Tensor, fraction: float) -> Tensor:
    """J(α) = mean of α (H − H̄) with H̄ = fraction · log(number of choices), over observations with a choice.

    Too little entropy raises α, too much lowers it. An observation with a single choice has nothing to decide and
    is left out; with none left the loss is 0.

    Args:
        log_alpha: log α, a scalar with gradient.
        entropy: H of every observation, shape (k,).
        choices: number of valid choices of every observation, shape (k,).
        fraction: share of the largest possible entropy that is aimed at.
    """
    goal = fraction * choices.clamp(min=1).float().log()
    return mean(log_alpha.exp() * (entropy.detach() - goal), choices > 1)
