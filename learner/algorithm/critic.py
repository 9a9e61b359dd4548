"""The hierarchical critics: Q(o, b, a) for all pairs of beacon and waypoint at once (docs/design.md)."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.decoders import DecoderLayer
from common.network.encoder import Encoder
from common.network.graph_batch import GraphBatch


class CriticHead(nn.Module):
    """One Q function over encoded nodes.

    Every beacon and every waypoint asks all viewpoints, beside the robot's feature; the two decoded features of a
    pair are joined by a fully connected layer, and a last one gives the value. In `vanilla` only waypoints ask.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.hierarchical = config.hierarchical
        self.ask_beacon = nn.Linear(2 * width, width) if self.hierarchical else None
        self.ask_waypoint = nn.Linear(2 * width, width)
        self.decoder = DecoderLayer(config)
        self.join_beacon = nn.Linear(width, width, bias=False) if self.hierarchical else None
        self.join_waypoint = nn.Linear(width, width)
        self.value = nn.Linear(width, 1)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Return Q of every pair of the batch, float32, shape (total pairs,)."""
        kv = self.decoder.keys_values(nodes)
        asking = self._join_robot(nodes, batch, batch.waypoint_rows, batch.waypoint_graph)
        waypoints = self.decoder(self.ask_waypoint(asking), batch.arrays.waypoint_ptr, kv, batch)
        joined = self.join_waypoint(waypoints).index_select(0, batch.pair_waypoint)
        if self.ask_beacon is not None and self.join_beacon is not None:
            asking = self._join_robot(nodes, batch, batch.beacon_rows, batch.beacon_graph)
            beacons = self.decoder(self.ask_beacon(asking), batch.arrays.beacon_ptr, kv, batch)
            joined = joined + self.join_beacon(beacons).index_select(0, batch.pair_beacon)
        return self.value(functional.relu(joined)).squeeze(1).float()

    @staticmethod
    def _join_robot(nodes: Tensor, batch: GraphBatch, rows: Tensor, owner: Tensor) -> Tensor:
        robots = nodes.index_select(0, batch.robot_rows.index_select(0, owner))
        return torch.cat([nodes.index_select(0, rows), robots], dim=1)


class Critic(nn.Module, ABC):
    """Twin Q functions of all pairs of an observation."""

    @abstractmethod
    def values(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return both Q of every pair of the batch, float32, shape (total pairs,) each."""

    def forward(self, batch: GraphBatch, known: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return both Q of every pair of the batch, float32, shape (total pairs,) each.

        Args:
            batch: the observations.
            known: what is known beforehand of the Q of each waypoint slot, shape (total waypoints,): the reward that
                a privileged critic is told. The networks then learn the rest, what comes after that reward.
        """
        first, second = self.values(batch)
        if known is None:
            return first, second
        offset = known.index_select(0, batch.pair_waypoint)
        return first + offset, second + offset


class HierarchicalCritic(Critic):
    """Twin Q functions on an encoder of their own.

    The twins share the encoder, which is nearly all of the cost, and have separate decoders and joins.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = Encoder(config)
        self.first = CriticHead(config)
        self.second = CriticHead(config)

    def values(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return both Q of every pair."""
        nodes = self.encoder(batch)
        return self.first(nodes, batch), self.second(nodes, batch)
