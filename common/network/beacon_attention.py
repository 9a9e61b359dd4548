"""Robot, beacons and target attend to one another, whatever lies between them.

Attention along edges carries word as far as there are layers; in a large world two beacons never hear of each other.
Here every token hears every other, and how much depends on the length of the path between them, too.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.feedforward import FeedForward
from common.network.graph_batch import GraphBatch
from common.observations.overview import CLOSENESS


class TokenLayer(nn.Module):
    """x + attention(norm(x)), then x + feed-forward(norm(x)); scores are biased by a linear map of the closeness."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.heads = config.heads
        self.attention_norm = nn.LayerNorm(width)
        self.qkv = nn.Linear(width, 3 * width, bias=False)
        self.bias = nn.Linear(CLOSENESS, config.heads, bias=False)
        self.out = nn.Linear(width, width)
        self.feedforward_norm = nn.LayerNorm(width)
        self.feedforward = FeedForward(width, config.feedforward)

    def forward(self, tokens: Tensor, closeness: Tensor, absent: Tensor) -> Tensor:
        """Map padded tokens (k, t, d) to the same.

        Args:
            tokens: of k observations.
            closeness: of every two, shape (k, t, t, `CLOSENESS`).
            absent: -inf for padding to attend to, else 0, shape (k, 1, 1, t).
        """
        k, t, width = tokens.shape
        qkv = self.qkv(self.attention_norm(tokens)).float().view(k, t, 3, self.heads, -1)
        query, key, value = qkv.permute(2, 0, 3, 1, 4)
        bias = self.bias(closeness).float().permute(0, 3, 1, 2) + absent
        mixed = functional.scaled_dot_product_attention(query, key, value, bias)
        tokens = tokens + self.out(mixed.transpose(1, 2).reshape(k, t, width))
        return tokens + self.feedforward(self.feedforward_norm(tokens))


class BeaconAttention(nn.Module):
    """Layers of attention among the tokens of each observation; what they learn is added to the encoded nodes.

    Its last map starts at zero, so that a network begins as if it were not there.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.layers = nn.ModuleList(TokenLayer(config) for _ in range(config.beacon_attention))
        self.norm = nn.LayerNorm(config.width)
        self.out = nn.Linear(config.width, config.width)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Map encoded nodes (nodes, d) to the same."""
        ptr = batch.arrays.token_ptr
        counts = np.diff(ptr)
        k, most = len(counts), int(counts.max())
        graph = np.repeat(np.arange(k), counts)
        place = np.arange(ptr[-1]) - np.repeat(ptr[:-1], counts)
        # Every two tokens of an observation, as `closeness` lists them.
        times = np.repeat(counts, counts)
        one = np.repeat(np.arange(ptr[-1]), times)
        other = np.arange(len(one)) - np.repeat(np.cumsum(times) - times, times)
        device = nodes.device
        at = torch.from_numpy(graph * most + place).to(device)
        between = torch.from_numpy((graph[one] * most + place[one]) * most + other).to(device)
        tokens = nodes.index_select(0, batch.token_rows)
        padded = tokens.new_zeros((k * most, tokens.shape[1])).index_copy(0, at, tokens).view(k, most, -1)
        closeness = batch.closeness.new_zeros((k * most * most, CLOSENESS)).index_copy(0, between, batch.closeness)
        absent = torch.full((k * most,), -torch.inf, device=device).index_fill(0, at, 0.0).view(k, 1, 1, most)
        for layer in self.layers:
            padded = layer(padded, closeness.view(k, most, most, CLOSENESS), absent)
        learnt = self.out(self.norm(padded.view(k * most, -1).index_select(0, at)))
        return nodes.index_add(0, batch.token_rows, learnt.to(nodes.dtype))
