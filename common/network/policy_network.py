"""The policy network π(b, a | o) = π_b(b | o) π_a(a | o, b), in the paper's three variants."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from common.config import NetworkConfig
from common.network.decoders import BeaconDecoder, WaypointDecoder
from common.network.encoder import Encoder
from common.network.graph_batch import GraphBatch


@dataclass(frozen=True, slots=True, eq=False)
class PolicyOutput:
    """What the policy network says about a batch; slots and pairs are those of the `GraphBatch`.

    Attributes:
        log_beacon: log π_b(b | o), float32, shape (total beacons,); zeros in `vanilla`.
        log_waypoint: log π_a(a | o, b) of every pair, float32, shape (total pairs,).
        beacon_features: decoded feature of each beacon, shape (total beacons, d); None in `vanilla`.
        waypoint_features: decoded feature of each waypoint, shape (total waypoints, d).
    """

    log_beacon: Tensor
    log_waypoint: Tensor
    beacon_features: Tensor | None
    waypoint_features: Tensor


class PolicyNetwork(nn.Module):
    """Encoder, beacon decoder and waypoint decoder (paper, section IV).

    The variant `vanilla` has no beacon decoder; `hierarchical` and `hdplanner` are one network, which the losses
    tell apart.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = Encoder(config)
        self.beacon_decoder = BeaconDecoder(config) if config.variant != "vanilla" else None
        self.waypoint_decoder = WaypointDecoder(config)

    def forward(self, batch: GraphBatch) -> PolicyOutput:
        """Compute all log-probabilities of a batch."""
        nodes = self.encoder(batch)
        log_waypoint, waypoint_features = self.waypoint_decoder(nodes, batch)
        if self.beacon_decoder is None:
            log_beacon, beacon_features = torch.zeros_like(batch.beacon_rows, dtype=torch.float32), None
        else:
            log_beacon, beacon_features = self.beacon_decoder(nodes, batch)
        return PolicyOutput(log_beacon, log_waypoint, beacon_features, waypoint_features)
