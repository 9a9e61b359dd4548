"""Imitation of a privileged expert that knows the cost of every waypoint.

What it brought, and what did not help, is in docs/design.md, "Imitation before reinforcement".
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from common.config import CloningConfig
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyOutput
from common.network.segment import segment_log_softmax, segment_sum
from learner.algorithm.auxiliary import Hints
from learner.algorithm.losses import entropies, log_marginal
from learner.algorithm.whole import mean


@dataclass(frozen=True, slots=True, eq=False)
class Guidance:
    """The expert's labels on the device, in the slots of a `GraphBatch`.

    Attributes:
        cost: metres of detour of each waypoint slot, float32, shape (total waypoints,).
        beacon: slot of the first beacon that the expert reaches, -1 where unknown, int64, shape (k,).
        labelled: observations that have labels, bool, shape (k,).
        wanted: probability of each waypoint slot that another teacher than the expert wants, float32, shape (total
            waypoints,).
        follows: observations in which that other teacher is followed, bool, shape (k,).
        hints: of what the robot cannot see yet; None where the labels have none.
    """

    cost: Tensor
    beacon: Tensor
    labelled: Tensor
    wanted: Tensor
    follows: Tensor
    hints: Hints | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CloningLoss:
    """The imitation loss and its parts, scalars; each part is a mean over the observations that it is about."""

    total: Tensor
    expected_cost: Tensor
    cross_entropy: Tensor
    beacon_cross_entropy: Tensor
    following: Tensor


def cloning_loss(output: PolicyOutput, guidance: Guidance, batch: GraphBatch, config: CloningConfig) -> CloningLoss:
    """Σ_a π(a) c(a) + w₁ CE(softmax(−c), π) + w₂ CE(expert's beacon, π_b) − w₃ H.

    π(a) = Σ_b π_b π_a(a | b) is the marginal of the waypoints, c their cost in units of `cost_scale`, at most
    `max_cost`, and H = H_b + H_a the policy's entropy. Observations without labels count nowhere. Where another teacher
    is followed, the cross entropy on its choice stands in the place of the first three terms.
    """
    k = len(batch)
    cost = (guidance.cost / config.cost_scale).clamp(max=config.max_cost)
    log_waypoint = log_marginal(output, batch)
    expected = segment_sum(log_waypoint.exp() * cost, batch.waypoint_graph, k)
    wanted = segment_log_softmax(-cost, batch.waypoint_graph, k).exp()
    cross = -segment_sum(wanted * log_waypoint, batch.waypoint_graph, k)
    beacon_entropy, waypoint_entropy = entropies(output, batch)
    following = -segment_sum(guidance.wanted * log_waypoint, batch.waypoint_graph, k)
    own = guidance.labelled & ~guidance.follows
    has_beacon = own & (guidance.beacon >= 0)
    log_wanted = output.log_beacon.index_select(0, guidance.beacon.clamp(min=0))
    parts = (
        mean(expected, own),
        mean(cross, own),
        mean(-log_wanted, has_beacon),
        mean(following, guidance.follows),
    )
    share = mean(own.float(), guidance.labelled)
    entropy = mean(beacon_entropy + waypoint_entropy, guidance.labelled)
    total = (
        share * (parts[0] + config.cross_entropy_weight * parts[1] + config.beacon_weight * parts[2])
        + (1.0 - share) * parts[3]
        - config.entropy_bonus * entropy
    )
    return CloningLoss(total, *parts)
