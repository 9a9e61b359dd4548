"""The policy network π(b, a | o) = π_b(b | o) π_a(a | o, b), in the paper's three variants."""

from __future__ import annotations

import torch

from common.config import NetworkConfig
from common.network.decoders import BeaconDecoder, WaypointDecoder
from common.network.encoder import Encoder
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyNetwork, PolicyOutput


class HierarchicalNetwork(PolicyNetwork):
    """Encoder, beacon decoder and waypoint decoder (paper, section IV).

    The variant `vanilla` has no beacon decoder; `hierarchical` and `hdplanner` are one network, which the losses
    tell apart.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.encoder = Encoder(config)
        self.beacon_decoder = BeaconDecoder(config) if config.hierarchical else None
        self.waypoint_decoder = WaypointDecoder(config)

    def forward(self, batch: GraphBatch) -> PolicyOutput:
        """Compute all log-probabilities of a batch."""
        nodes, cells = self.encoder.encode(batch)
        log_waypoint, waypoint_features = self.waypoint_decoder(nodes, batch)
        if self.beacon_decoder is None:
            log_beacon, beacon_features = torch.zeros_like(batch.beacon_rows, dtype=torch.float32), None
        else:
            log_beacon, beacon_features = self.beacon_decoder(nodes, batch)
        return PolicyOutput(log_beacon, log_waypoint, beacon_features, waypoint_features, nodes, cells)
