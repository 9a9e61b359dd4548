"""The decoders: attention of few queries over all nodes, and pointers that choose among beacons and waypoints."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.attention import CrossAttention
from common.network.feedforward import FeedForward
from common.network.graph_batch import GraphBatch
from common.network.logits import LOGIT_LIMIT
from common.network.segment import segment_log_softmax
from common.observations.overview import PAIR_FEATURES


class DecoderLayer(nn.Module):
    """q + attention(norm(q) over nodes), then q + feed-forward(norm(q)), and a last norm."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.attention_norm = nn.LayerNorm(config.width)
        self.attention = CrossAttention(config.width, config.heads)
        self.feedforward_norm = nn.LayerNorm(config.width)
        self.feedforward = FeedForward(config.width, config.feedforward)
        self.norm = nn.LayerNorm(config.width)

    def keys_values(self, nodes: Tensor) -> Tensor:
        """Return keys and values of encoded nodes (nodes, d), side by side, shape (nodes, 2 d)."""
        return self.attention.kv(nodes)

    def forward(self, queries: Tensor, query_ptr: np.ndarray, kv: Tensor, batch: GraphBatch) -> Tensor:
        """Decode queries (queries, d), grouped by ``query_ptr`` (k + 1,), over the nodes' `keys_values`."""
        queries = queries + self.attention(self.attention_norm(queries), query_ptr, kv, batch)
        return self.norm(queries + self.feedforward(self.feedforward_norm(queries)))


class Pointer(nn.Module):
    """Scaled, squashed dot products of a decoded query with the features of its choices: 10 tanh(q k / sqrt d)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.query = nn.Linear(width, width, bias=False)
        self.key = nn.Linear(width, width, bias=False)

    def forward(self, queries: Tensor, keys: Tensor) -> Tensor:
        """Return logits, float32, shape (items,), of projected queries and keys, both (items, d)."""
        scores = (queries.float() * keys.float()).sum(-1) / queries.shape[-1] ** 0.5
        return LOGIT_LIMIT * torch.tanh(scores)


class DetourBias(nn.Module):
    """What is added to the logit of a waypoint given a beacon for how the one lies to the other; zero at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.rise = nn.Linear(PAIR_FEATURES, width)
        self.fall = nn.Linear(width, 1)
        nn.init.zeros_(self.fall.weight)
        nn.init.zeros_(self.fall.bias)

    def forward(self, features: Tensor) -> Tensor:
        """Map features of pairs, (pairs, `PAIR_FEATURES`), to biases, float32, shape (pairs,)."""
        return self.fall(functional.relu(self.rise(features))).squeeze(1).float()


class BeaconDecoder(nn.Module):
    """π_b(b | o): the robot's feature asks all viewpoints, then points at a beacon (paper, section IV-C)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.decoder = DecoderLayer(config)
        self.pointer = Pointer(config.width)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return log π_b, shape (total beacons,), and the beacons' pointer features, (total beacons, d)."""
        one_each = np.arange(len(batch) + 1)
        robots = nodes.index_select(0, batch.robot_rows)
        queries = self.pointer.query(self.decoder(robots, one_each, self.decoder.keys_values(nodes), batch))
        keys = self.pointer.key(nodes.index_select(0, batch.beacon_rows))
        logits = self.pointer(queries.index_select(0, batch.beacon_graph), keys)
        return segment_log_softmax(logits, batch.beacon_graph, len(batch)), keys


class WaypointDecoder(nn.Module):
    """π_a(a | o, b): the beacon's and the robot's feature ask all viewpoints, then point at a waypoint.

    All beacons are decoded at once. In `vanilla` the robot's feature asks alone.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.hierarchical = config.hierarchical
        self.join = nn.Linear((2 if self.hierarchical else 1) * config.width, config.width)
        self.decoder = DecoderLayer(config)
        self.pointer = Pointer(config.width)
        # Added to the logits of waypoints on a shortest path to the beacon.
        self.toward = nn.Parameter(torch.zeros(1)) if config.toward else None
        self.detours = DetourBias(config.width) if config.detours else None

    def forward(self, nodes: Tensor, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return log π_a, shape (total pairs,), and the waypoints' pointer features, (total waypoints, d)."""
        asking = nodes.index_select(0, batch.beacon_rows)
        if self.hierarchical:
            robots = nodes.index_select(0, batch.robot_rows.index_select(0, batch.beacon_graph))
            asking = torch.cat([asking, robots], dim=1)
        kv = self.decoder.keys_values(nodes)
        queries = self.decoder(self.join(asking), batch.arrays.beacon_ptr, kv, batch)
        queries = self.pointer.query(queries).index_select(0, batch.pair_beacon)
        keys = self.pointer.key(nodes.index_select(0, batch.waypoint_rows))
        logits = self.pointer(queries, keys.index_select(0, batch.pair_waypoint))
        if self.toward is not None:
            logits = logits + self.toward * batch.toward
        if self.detours is not None:
            logits = logits + self.detours(batch.pair_features)
        return segment_log_softmax(logits, batch.pair_beacon, len(batch.beacon_rows)), keys
