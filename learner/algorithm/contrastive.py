"""Contrastive joint optimisation (paper, Algorithm 2): draws the policy to the choice that its judge prefers."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from common.config import ContrastiveConfig
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyOutput
from common.network.segment import segment_argmax, segment_sum
from learner.algorithm.losses import waypoint_marginal
from learner.algorithm.whole import mean


def contrastive_loss(
    output: PolicyOutput, batch: GraphBatch, q: Tensor, config: ContrastiveConfig, draw: Callable[[int], Tensor]
) -> Tensor:
    """Return the triplet loss over waypoints, and over beacons where that is configured; a scalar.

    Args:
        output: the policy on the batch.
        batch: the observations.
        q: the judge's value of every pair, shape (total pairs,).
        config: the margin, and whether beacons take part.
        draw: gives a random number in [0, 1) for each of so many choices.
    """
    assert output.waypoint_features is not None, "the contrastive loss is for the variant `hdplanner` alone"
    chance = draw(len(batch.waypoint_rows))
    with torch.no_grad():
        ones = torch.ones_like(q)
        probability = waypoint_marginal(output.log_waypoint.exp(), output, batch)
        weight = waypoint_marginal(ones, output, batch)
        value = waypoint_marginal(q, output, batch) / weight.clamp(min=1e-12)
        chosen = triplets(probability, value, chance, batch.waypoint_graph, len(batch))
    loss = triplet_loss(output.waypoint_features, *chosen, config.margin)
    if config.beacons and output.beacon_features is not None:
        chance = draw(len(batch.beacon_rows))
        with torch.no_grad():
            worth = segment_sum(output.log_waypoint.exp() * q, batch.pair_beacon, len(batch.beacon_rows))
            chosen = triplets(output.log_beacon, worth, chance, batch.beacon_graph, len(batch))
        loss = loss + triplet_loss(output.beacon_features, *chosen, config.margin)
    return loss


def triplets(
    scores: Tensor, best: Tensor, chance: Tensor, owner: Tensor, segments: int
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Choose anchor, positive and negative of every observation (Algorithm 2).

    Args:
        scores: the policy's probability of each choice, shape (items,); its best is the anchor.
        best: the value of each choice by the (target) Q network; its best is the positive.
        chance: random numbers in [0, 1), shape (items,); the largest among the other choices is the negative.
        owner: observation of each choice, shape (items,).
        segments: number k of observations.

    Returns:
        Indices of anchor, positive and negative, and whether the observation takes part, shape (k,) each. Those with
        fewer than three choices do not, and their indices mean nothing (but are valid).
    """
    items = len(scores)
    size = segment_sum(torch.ones_like(owner), owner, segments)
    anchor = segment_argmax(scores, owner, segments).clamp(max=max(items - 1, 0))
    positive = segment_argmax(best, owner, segments).clamp(max=max(items - 1, 0))
    index = torch.arange(items, device=owner.device)
    taken = (index == anchor.index_select(0, owner)) | (index == positive.index_select(0, owner))
    others = torch.where(taken, torch.full_like(chance, -1.0), chance)
    negative = segment_argmax(others, owner, segments).clamp(max=max(items - 1, 0))
    return anchor, positive, negative, size >= 3


def triplet_loss(
    features: Tensor, anchor: Tensor, positive: Tensor, negative: Tensor, valid: Tensor, margin: float
) -> Tensor:
    """Mean of max(0, |f_â − f_a⁺| − |f_â − f_a⁻| + m) over the valid triplets (Algorithm 2); 0 without one.

    Features are compared as unit vectors, so that the margin means the same for every width; distances are Euclidean.

    Args:
        features: decoded features, shape (items, d).
        anchor: item of each triplet's anchor, shape (k,).
        positive: item of its positive, shape (k,).
        negative: item of its negative, shape (k,).
        valid: triplets that count, bool, shape (k,).
        margin: m.
    """
    if features.shape[0] == 0:
        return mean(features.sum(1), valid[:0])
    unit = functional.normalize(features.float(), dim=1)
    here = unit.index_select(0, anchor)
    near = _distance(here, unit.index_select(0, positive))
    far = _distance(here, unit.index_select(0, negative))
    hinge = functional.relu(near - far + margin)
    return mean(hinge, valid)


def _distance(a: Tensor, b: Tensor) -> Tensor:
    """Euclidean distance of rows; the small term keeps its gradient finite where they are equal."""
    return ((a - b).square().sum(1) + 1e-12).sqrt()
