"""The policy network for one observation at a time, in numpy: what actors and robots run.

The mathematics and the weights are exactly those of the networks in torch; a test holds the two equal. Without torch a
decision costs less (no dispatch, no autograd bookkeeping, reused buffers), and a robot needs no torch at all.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.beacon_inference import beacon_attention, detour_bias
from common.network.belief_inference import BeliefInference
from common.network.edge_kernels import edge_kernels
from common.network.graph_arrays import GraphArrays
from common.network.image_inference import ImageInference
from common.network.logits import LOGIT_LIMIT, log_softmax
from common.network.parameters import Arrays
from common.system.jit import njit

_EPSILON = 1e-5
# In the place of attention weights, which only training needs.
_NOTHING = np.empty((0, 0, 0), dtype=np.float32)

Array = NDArray[np.float32]


class DecisionNetwork(Protocol):
    """An engine that runs the policy network for one observation."""

    def __call__(self, graph: GraphArrays) -> tuple[Array, Array]:
        """Return log π_b, shape (beacons,), and log π_a given each beacon, shape (beacons, waypoints).

        Args:
            graph: exactly one observation, with at least one beacon and one waypoint.
        """
        ...


def make_inference(config: NetworkConfig, arrays: Arrays) -> DecisionNetwork:
    """Return the network of ``config.variant`` with these weights, which the caller has checked."""
    if config.variant == "cnn":
        return ImageInference(config, arrays)
    return GraphInference(config, arrays)


class GraphInference:
    """Encoder and decoders over one observation; not for use by two threads at once (the buffers are shared).

    Args:
        config: the network's configuration.
        arrays: its weights, checked by the caller.
    """

    def __init__(self, config: NetworkConfig, arrays: Arrays) -> None:
        self.config = config
        # Linear maps multiply from the right, so their weights are laid out (inputs, outputs).
        self._weights = {
            name: np.ascontiguousarray(value.T if value.ndim == 2 else value) for name, value in arrays.items()
        }
        self._edge_attention, _ = edge_kernels(config.width // config.heads, config.heads)
        self._belief = BeliefInference(config, arrays) if config.belief_map else None
        self._buffers: dict[str, Array] = {}

    def __call__(self, graph: GraphArrays) -> tuple[Array, Array]:
        """Return log π_b, shape (beacons,), and log π_a given each beacon, shape (beacons, waypoints).

        Args:
            graph: exactly one observation, with at least one beacon and one waypoint.
        """
        nodes = self._encode(graph)
        if self.config.beacon_attention:
            beacon_attention(self._weights, self.config, nodes, graph)
        robot = nodes[graph.robot_rows]
        beacons = nodes[graph.beacon_rows]
        waypoints = nodes[graph.waypoint_rows]
        if graph.has_beacons:
            asked = self._decode("beacon_decoder", robot.copy(), nodes)
            log_beacon = log_softmax(self._point("beacon_decoder", asked, beacons))[0]
            joined = np.concatenate([beacons, np.repeat(robot, len(beacons), axis=0)], axis=1)
        else:
            log_beacon = np.zeros(1, dtype=np.float32)
            joined = robot
        if self.config.baseline:
            asked = self._decode("waypoint_decoder", robot.copy(), nodes)
            asked = self._linear("waypoint_decoder.join", np.concatenate([asked, robot], axis=1))
        else:
            asked = self._decode("waypoint_decoder", self._linear("waypoint_decoder.join", joined), nodes)
        logits = self._point("waypoint_decoder", asked, waypoints)
        if self.config.toward:
            logits += self._weights["waypoint_decoder.toward"] * graph.toward.reshape(logits.shape)
        if self.config.detours:
            logits += detour_bias(self._weights, graph).reshape(logits.shape)
        return log_beacon, log_softmax(logits)

    def _encode(self, graph: GraphArrays) -> Array:
        weights, width = self._weights, self.config.width
        count = len(graph.neighbours)
        nodes = self._buffer("nodes", count, width)
        normed = self._buffer("normed", count, width)
        mixed = self._buffer("mixed", count, width)
        change = self._buffer("change", count, width)
        qkv = self._buffer("qkv", count, 3 * width)
        hidden = self._buffer("hidden", count, self.config.feedforward * width)
        np.matmul(graph.features, weights["encoder.embedding.weight"], out=nodes)
        bias = weights["encoder.embedding.bias"]
        change[:] = 0.0 if self._belief is None else self._belief(graph)
        for layer in range(self.config.layers):
            name = f"encoder.layers.{layer}"
            _add_and_norm(nodes, change, bias, *self._norm(f"{name}.attention_norm"), normed)
            np.matmul(normed, weights[f"{name}.attention.qkv.weight"], out=qkv)
            self._edge_attention(qkv, graph.neighbours, mixed, _NOTHING, 0, count)
            np.matmul(mixed, weights[f"{name}.attention.out.weight"], out=change)
            bias = weights[f"{name}.attention.out.bias"]
            _add_and_norm(nodes, change, bias, *self._norm(f"{name}.feedforward_norm"), normed)
            np.matmul(normed, weights[f"{name}.feedforward.rise.weight"], out=hidden)
            _relu(hidden, weights[f"{name}.feedforward.rise.bias"])
            np.matmul(hidden, weights[f"{name}.feedforward.fall.weight"], out=change)
            bias = weights[f"{name}.feedforward.fall.bias"]
        _add_and_norm(nodes, change, bias, *self._norm("encoder.norm"), normed)
        return normed

    def _decode(self, decoder: str, queries: Array, nodes: Array) -> Array:
        """Run the decoder layer for a few queries, which it overwrites.

        There are far more nodes than queries, so the weights of keys and values go to the queries' side of the
        products: q (n K)^T = (q K^T) n^T, and w (n V) = (w n) V.
        """
        weights, name = self._weights, f"{decoder}.decoder"
        count, width, heads = len(queries), self.config.width, self.config.heads
        normed, nothing = np.empty_like(queries), np.zeros_like(queries)
        no_bias: Array = nothing[0]
        _add_and_norm(queries, nothing, no_bias, *self._norm(f"{name}.attention_norm"), normed)
        asking = normed @ weights[f"{name}.attention.query.weight"] / np.float32(math.sqrt(width // heads))
        asking = asking.reshape(count, heads, -1)
        kv = weights[f"{name}.attention.kv.weight"].reshape(width, 2, heads, -1)
        asking = np.matmul(asking.transpose(1, 0, 2), kv[:, 0].transpose(1, 2, 0))  # (heads, queries, d)
        shares = self._buffer("cross", heads * count, len(nodes))
        np.matmul(asking.reshape(-1, width), nodes.T, out=shares)
        shares -= shares.max(axis=1, keepdims=True)
        np.exp(shares, out=shares)
        mixed = shares @ nodes / shares.sum(axis=1, keepdims=True)
        mixed = np.matmul(mixed.reshape(heads, count, width), kv[:, 1].transpose(1, 0, 2))
        mixed = np.ascontiguousarray(mixed.transpose(1, 0, 2)).reshape(count, width)
        change = mixed @ weights[f"{name}.attention.out.weight"]
        bias = weights[f"{name}.attention.out.bias"]
        _add_and_norm(queries, change, bias, *self._norm(f"{name}.feedforward_norm"), normed)
        hidden: Array = normed @ weights[f"{name}.feedforward.rise.weight"]
        _relu(hidden, weights[f"{name}.feedforward.rise.bias"])
        change = hidden @ weights[f"{name}.feedforward.fall.weight"]
        bias = weights[f"{name}.feedforward.fall.bias"]
        _add_and_norm(queries, change, bias, *self._norm(f"{name}.norm"), normed)
        return normed

    def _point(self, decoder: str, asked: Array, choices: Array) -> Array:
        """Return the pointer's logits, shape (queries, choices)."""
        queries = asked @ self._weights[f"{decoder}.pointer.query.weight"]
        keys = choices @ self._weights[f"{decoder}.pointer.key.weight"]
        return np.float32(LOGIT_LIMIT) * np.tanh(queries @ keys.T / np.float32(math.sqrt(self.config.width)))

    def _linear(self, name: str, inputs: Array) -> Array:
        return inputs @ self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"]

    def _norm(self, name: str) -> tuple[Array, Array]:
        return self._weights[f"{name}.weight"], self._weights[f"{name}.bias"]

    def _buffer(self, name: str, rows: int, columns: int) -> Array:
        """Return a contiguous scratch array; its memory is kept and grows to the largest use."""
        size = rows * columns
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = np.empty(size + size // 2, dtype=np.float32)
            self._buffers[name] = buffer
        return buffer[:size].reshape(rows, columns)


@njit(cache=True, nogil=True, fastmath=True)
def _add_and_norm(nodes: Array, change: Array, bias: Array, gain: Array, shift: Array, out: Array) -> None:
    """Add ``change + bias`` to ``nodes`` in place, and write their layer norm to ``out``."""
    width = nodes.shape[1]
    for i in range(nodes.shape[0]):
        total = np.float32(0.0)
        for c in range(width):
            nodes[i, c] += change[i, c] + bias[c]
        for c in range(width):
            total += nodes[i, c]
        mean = total / np.float32(width)
        spread = np.float32(0.0)
        for c in range(width):
            spread += (nodes[i, c] - mean) * (nodes[i, c] - mean)
        factor = np.float32(1.0) / np.float32(math.sqrt(spread / np.float32(width) + np.float32(_EPSILON)))
        for c in range(width):
            out[i, c] = (nodes[i, c] - mean) * factor * gain[c] + shift[c]


@njit(cache=True, nogil=True, fastmath=True)
def _relu(hidden: Array, bias: Array) -> None:
    """Add the bias and clip at zero, in place."""
    for i in range(hidden.shape[0]):
        for c in range(hidden.shape[1]):
            hidden[i, c] = max(hidden[i, c] + bias[c], np.float32(0.0))
