"""A transition batch as the update needs it: tensors on the learner's device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from common.config.schema import NetworkConfig
from common.network.graph_batch import GraphBatch
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.cloning import Guidance


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A transition batch on the device.

    Attributes:
        now: the observations.
        after: the observations o' that are bootstrapped, None without any.
        bootstrapped: transitions whose o' is in ``after``, indices, int64.
        learnable: transitions with a known o', indices, int64.
        chosen: pair of each transition, int64, shape (k,).
        rewards: shape (k,).
        discounts: shape (k,).
        terminal: shape (k,).
        guidance: the expert's labels, None without any.
    """

    now: GraphBatch
    after: GraphBatch | None
    bootstrapped: Tensor
    learnable: Tensor
    chosen: Tensor
    rewards: Tensor
    discounts: Tensor
    terminal: Tensor
    guidance: Guidance | None

    @classmethod
    def make(cls, batch: TransitionBatch, network: NetworkConfig, device: torch.device, bootstrap: bool) -> Sample:
        """Build graphs and slots on the host and move them to the device.

        Args:
            batch: what the replay buffer drew.
            network: the network that reads it.
            device: where to.
            bootstrap: also prepare o', which imitation does not need.

        Raises:
            ValueError: a chosen node is no beacon or waypoint of its observation.
        """
        now = GraphBatch.from_observations(batch.observations, network)
        known = batch.next_valid & ~batch.terminal
        after = None
        if bootstrap and known.any():
            after = GraphBatch.from_observations(batch.next_observations.select(known), network).to(device)
        guidance = None
        if batch.labels is not None and batch.labelled.any():
            guidance = Guidance(
                cost=torch.from_numpy(batch.labels.cost).to(device),
                beacon=torch.from_numpy(now.arrays.beacon_slots(batch.labels.beacon)).to(device),
                labelled=torch.from_numpy(batch.labelled).to(device),
            )
        return cls(
            now=now.to(device),
            after=after,
            bootstrapped=torch.from_numpy(np.flatnonzero(known)).to(device),
            learnable=torch.from_numpy(np.flatnonzero(batch.next_valid | batch.terminal)).to(device),
            chosen=torch.from_numpy(now.arrays.pair_index(batch.beacons, batch.waypoints)).to(device),
            rewards=torch.from_numpy(batch.rewards).to(device),
            discounts=torch.from_numpy(batch.discounts).to(device),
            terminal=torch.from_numpy(batch.terminal).to(device),
            guidance=guidance,
        )
