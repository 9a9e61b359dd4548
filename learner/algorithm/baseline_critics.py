"""The critics of the learned baselines: as their publications have them, as twins that share an encoder."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.decoders import DecoderLayer
from common.network.encoder import Encoder
from common.network.graph_batch import GraphBatch
from common.network.image_network import ImageEncoder, PlaceTable
from common.network.pointer_network import ask_robots
from learner.algorithm.critic import Critic


class PointerCriticHead(nn.Module):
    """Q of ARiADNE and of context-aware navigation: the decoded robot, the robot and a neighbour, joined.

    The publications join them by two linear maps in a row; here a ReLU stands between.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.decoder = DecoderLayer(config)
        self.join = nn.Linear(3 * config.width, config.width)
        self.value = nn.Linear(config.width, 1)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Return Q of every waypoint slot, float32, shape (total waypoints,)."""
        asked = ask_robots(self.decoder, nodes, batch).index_select(0, batch.waypoint_graph)
        joined = self.join(torch.cat([asked, nodes.index_select(0, batch.waypoint_rows)], dim=1))
        return self.value(functional.relu(joined)).squeeze(1).float()


class PointerCritic(Critic):
    """Twin Q functions over encoded viewpoints, for the variants `ariadne` and `ca`."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = Encoder(config)
        self.first = PointerCriticHead(config)
        self.second = PointerCriticHead(config)

    def values(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return both Q of every pair: an observation's waypoints are its pairs."""
        nodes = self.encoder(batch)
        return self.first(nodes, batch), self.second(nodes, batch)


class ImageCritic(Critic):
    """Twin Q functions over images, for the variant `cnn`; its published network is nothing else."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = ImageEncoder(config)
        self.first = PlaceTable(config)
        self.second = PlaceTable(config)

    def values(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return both Q of every pair: an observation's waypoints are its pairs."""
        encoded = self.encoder(batch)
        return self.first(encoded, batch), self.second(encoded, batch)
