"""The viewpoint encoder: pre-norm transformer layers whose attention runs along the edges of the graph."""

from __future__ import annotations

from torch import Tensor, nn

from common.config import NetworkConfig
from common.network.attention import EdgeAttention
from common.network.beacon_attention import BeaconAttention
from common.network.belief_map import BeliefMap
from common.network.feedforward import FeedForward
from common.network.graph_batch import GraphBatch
from common.observations.feature_sets import feature_count


class EncoderLayer(nn.Module):
    """x + attention(norm(x)), then x + feed-forward(norm(x)).

    What reads no graph is in methods of its own, which `learner.algorithm.compiled` compiles.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.attention_norm = nn.LayerNorm(config.width)
        self.attention = EdgeAttention(config.width, config.heads)
        self.feedforward_norm = nn.LayerNorm(config.width)
        self.feedforward = FeedForward(config.width, config.feedforward)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Map node features (nodes, d) to (nodes, d)."""
        return self.complete(nodes, self.attention.mix(self.project(nodes), batch))

    def project(self, nodes: Tensor) -> Tensor:
        """Return queries, keys and values of nodes (nodes, d), side by side, shape (nodes, 3 d)."""
        qkv: Tensor = self.attention.qkv(self.attention_norm(nodes))
        return qkv

    def complete(self, nodes: Tensor, mixed: Tensor) -> Tensor:
        """Return the layer's output for its input and what `EdgeAttention.mix` made of it, all (nodes, d)."""
        nodes = nodes + self.attention.out(mixed)
        return nodes + self.feedforward(self.feedforward_norm(nodes))


class Encoder(nn.Module):
    """Viewpoint encoder of policy and critics (paper, section IV-B)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.embedding = nn.Linear(feature_count(config.features), config.width)
        self.layers = nn.ModuleList(EncoderLayer(config) for _ in range(config.layers))
        self.norm = nn.LayerNorm(config.width)
        self.belief_map = BeliefMap(config) if config.belief_map else None
        self.beacon_attention = BeaconAttention(config) if config.beacon_attention else None

    def forward(self, batch: GraphBatch) -> Tensor:
        """Encode all nodes of a batch: float32 or the autocast type, shape (nodes, d)."""
        return self.encode(batch)[0]

    def encode(self, batch: GraphBatch) -> tuple[Tensor, Tensor | None]:
        """Encode all nodes; return also the values of the belief's cells, (cells, channels), where it is read."""
        nodes: Tensor = self.embedding(batch.features)
        values: Tensor | None = None
        if self.belief_map is not None:
            shown, values = self.belief_map(batch)
            nodes = nodes + shown
        for layer in self.layers:
            nodes = layer(nodes, batch)
        nodes = self.norm(nodes)
        return (nodes if self.beacon_attention is None else self.beacon_attention(nodes, batch)), values
