"""What `BeaconAttention` and `DetourBias` say of one observation, in numpy; see `common.network.inference`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.observations.overview import CLOSENESS

_EPSILON = 1e-5

Array = NDArray[np.float32]


def beacon_attention(weights: Mapping[str, Array], config: NetworkConfig, nodes: Array, graph: GraphArrays) -> None:
    """Add to the encoded nodes, (nodes, d), what robot, beacons and target learn of one another, in place.

    Args:
        weights: linear maps laid out (inputs, outputs).
        config: the network's configuration.
        nodes: of one observation.
        graph: likewise.
    """
    tokens = nodes[graph.token_rows]
    count, width, heads = len(tokens), config.width, config.heads
    closeness = graph.closeness.reshape(count, count, CLOSENESS)
    for layer in range(config.beacon_attention):
        name = f"encoder.beacon_attention.layers.{layer}"
        qkv = _norm(weights, f"{name}.attention_norm", tokens) @ weights[f"{name}.qkv.weight"]
        query, key, value = qkv.reshape(count, 3, heads, -1).transpose(1, 2, 0, 3)
        scores = query @ key.transpose(0, 2, 1) / np.float32(math.sqrt(width // heads))
        scores += (closeness @ weights[f"{name}.bias.weight"]).transpose(2, 0, 1)
        shares = np.exp(scores - scores.max(axis=2, keepdims=True))
        shares /= shares.sum(axis=2, keepdims=True)
        mixed = (shares @ value).transpose(1, 0, 2).reshape(count, width)
        tokens = tokens + _linear(weights, f"{name}.out", mixed)
        normed = _norm(weights, f"{name}.feedforward_norm", tokens)
        hidden = np.maximum(_linear(weights, f"{name}.feedforward.rise", normed), np.float32(0.0))
        tokens = tokens + _linear(weights, f"{name}.feedforward.fall", hidden)
    learnt = _norm(weights, "encoder.beacon_attention.norm", tokens)
    nodes[graph.token_rows] += _linear(weights, "encoder.beacon_attention.out", learnt)


def detour_bias(weights: Mapping[str, Array], graph: GraphArrays) -> Array:
    """Return what is added to the logits of all pairs for their detours, shape (pairs,)."""
    name = "waypoint_decoder.detours"
    hidden = np.maximum(_linear(weights, f"{name}.rise", graph.pair_features), np.float32(0.0))
    return _linear(weights, f"{name}.fall", hidden)[:, 0]


def _linear(weights: Mapping[str, Array], name: str, inputs: Array) -> Array:
    return inputs @ weights[f"{name}.weight"] + weights[f"{name}.bias"]


def _norm(weights: Mapping[str, Array], name: str, inputs: Array) -> Array:
    centred = inputs - inputs.mean(axis=1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=1, keepdims=True) + np.float32(_EPSILON))
    normed: Array = centred / spread * weights[f"{name}.weight"] + weights[f"{name}.bias"]
    return normed
