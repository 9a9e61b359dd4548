"""A transition batch as the update needs it: tensors on the learner's device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.config import RunConfig
from common.network.graph_batch import GraphBatch
from common.observations.index import waypoint_counts
from learner.algorithm.auxiliary import Hints
from learner.algorithm.batch import Graphs, TransitionBatch
from learner.algorithm.cloning import Guidance
from learner.algorithm.teachers import Teachers
from learner.algorithm.whole import whole_count


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A transition batch on the device.

    Attributes:
        batch: what it was made of.
        now: the observations.
        after: the observations o' that are bootstrapped, None without any.
        bootstrapped: transitions whose o' is in ``after``, indices, int64.
        learnable: transitions with a known o', indices, int64.
        chosen: pair of each transition, int64, shape (k,).
        rewards: shape (k,).
        discounts: shape (k,).
        terminal: shape (k,).
        guidance: the expert's labels, None without any.
        told: what a privileged critic is told of each waypoint slot of ``now``: minus its detour in units of reward,
            shape (total waypoints,); None for critics that are told nothing.
        told_after: likewise of ``after``.
    """

    batch: TransitionBatch
    now: GraphBatch
    after: GraphBatch | None
    bootstrapped: Tensor
    learnable: Tensor
    chosen: Tensor
    rewards: Tensor
    discounts: Tensor
    terminal: Tensor
    guidance: Guidance | None
    told: Tensor | None
    told_after: Tensor | None

    @classmethod
    def make(
        cls, batch: TransitionBatch, config: RunConfig, device: torch.device, bootstrap: bool, teachers: Teachers
    ) -> Sample:
        """Build graphs and slots on the host and move them to the device.

        Args:
            batch: what the replay buffer drew.
            config: the networks that read it, and what the critics are told.
            device: where to.
            bootstrap: also prepare o', which imitation does not need.
            teachers: whom imitation follows.

        Raises:
            ValueError: a chosen node is no beacon or waypoint of its observation; a privileged critic shall learn
                from a transition without labels.
        """
        privileged = bootstrap and config.sac.privileged_critic
        graphs = batch.graphs or make_graphs(batch, config, device, bootstrap)
        now = graphs.now
        told = told_after = None
        if privileged:
            if batch.labels is None or batch.next_labels is None or not batch.labelled.all():
                raise ValueError("a privileged critic learns only from labelled transitions: sample those")
            told = told_rewards(torch.from_numpy(batch.labels.cost), config).to(device)
        usable = _usable(batch, config, bootstrap)
        known = usable & ~batch.terminal
        if graphs.after is not None and privileged and batch.next_labels is not None:
            choices = waypoint_counts(batch.next_observations)
            cost = batch.next_labels.cost[np.repeat(known, choices)]
            told_after = told_rewards(torch.from_numpy(cost), config).to(device)
        guidance = None
        if batch.labels is not None and whole_count(int(batch.labelled.sum())):
            wanted, follows = teachers.wanted(batch, now.arrays)
            guidance = Guidance(
                cost=torch.from_numpy(batch.labels.cost).to(device),
                beacon=torch.from_numpy(now.arrays.beacon_slots(batch.labels.beacon)).to(device),
                labelled=torch.from_numpy(batch.labelled).to(device),
                wanted=torch.from_numpy(wanted).to(device),
                follows=torch.from_numpy(follows).to(device),
                hints=Hints.of(batch.observations, batch.labels, batch.labelled, now.arrays, device),
            )
        return cls(
            batch=batch,
            now=now,
            after=graphs.after,
            bootstrapped=torch.from_numpy(np.flatnonzero(known)).to(device),
            learnable=torch.from_numpy(np.flatnonzero(usable | batch.terminal)).to(device),
            chosen=torch.from_numpy(now.arrays.pair_index(batch.beacons, batch.waypoints)).to(device),
            rewards=torch.from_numpy(batch.rewards).to(device),
            discounts=torch.from_numpy(batch.discounts).to(device),
            terminal=torch.from_numpy(batch.terminal).to(device),
            guidance=guidance,
            told=told,
            told_after=told_after,
        )


def make_graphs(batch: TransitionBatch, config: RunConfig, device: torch.device, bootstrap: bool) -> Graphs:
    """Build what the networks read on the host, and move it to the device.

    Args:
        batch: what the replay buffer drew.
        config: the networks that read it.
        device: where to.
        bootstrap: also of o', which imitation does not need.
    """
    after = None
    known = _usable(batch, config, bootstrap) & ~batch.terminal
    if bootstrap and known.any():
        after = GraphBatch.from_observations(batch.next_observations.select(known), config.network).to(device)
    return Graphs(GraphBatch.from_observations(batch.observations, config.network).to(device), after)


def _usable(batch: TransitionBatch, config: RunConfig, bootstrap: bool) -> NDArray[np.bool_]:
    """Return where critics can learn: o' is known, bool, shape (k,)."""
    if not bootstrap or not config.sac.privileged_critic:
        return batch.next_valid
    # The o' of a time limit has no labels, because nothing was decided there.
    return batch.next_valid & (batch.next_labelled | batch.terminal)


def told_rewards(cost: Tensor, config: RunConfig) -> Tensor:
    """Return minus the detours, in units of the potential reward; dead ends count as the imitation loss counts them."""
    largest = config.cloning.max_cost * config.cloning.cost_scale
    return -cost.clamp(max=largest) / config.reward.potential_scale


def largest_told(config: RunConfig) -> float:
    """Return the largest detour that counts, in units of the potential reward."""
    return config.cloning.max_cost * config.cloning.cost_scale / config.reward.potential_scale
