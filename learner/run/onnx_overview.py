"""ONNX operators for what a network reads of paths between robot, beacons and target."""

from __future__ import annotations

import math

import numpy as np

from common.observations.overview import PAIR_FEATURES
from learner.run.onnx_builder import Builder


def beacon_attention(builder: Builder, nodes: str) -> str:
    """Add what the tokens (inputs ``tokens`` and ``closeness``) learn of one another to encoded nodes (N, d)."""
    config = builder.config
    width, heads = config.width, config.heads
    tokens = builder.op("Gather", nodes, "tokens", axis=0)
    for layer in range(config.beacon_attention):
        name = f"encoder.beacon_attention.layers.{layer}"
        normed = builder.norm(f"{name}.attention_norm", tokens)
        weight = builder.arrays[f"{name}.qkv.weight"]
        query, key, value = (
            builder.split_heads(builder.op("MatMul", normed, builder.constant(part.T)))
            for part in (weight[:width] / np.float32(math.sqrt(width // heads)), weight[width:-width], weight[-width:])
        )
        bias = builder.op("MatMul", "closeness", builder.constant(builder.arrays[f"{name}.bias.weight"].T))
        bias = builder.op("Transpose", bias, perm=[2, 0, 1])
        scores = builder.op("MatMul", query, builder.op("Transpose", key, perm=[0, 2, 1]))
        shares = builder.op("Softmax", builder.op("Add", scores, bias), axis=-1)
        mixed = builder.join_heads(builder.op("MatMul", shares, value))
        tokens = builder.op("Add", tokens, builder.linear(f"{name}.out", mixed))
        normed = builder.norm(f"{name}.feedforward_norm", tokens)
        tokens = builder.op("Add", tokens, builder.feedforward(f"{name}.feedforward", normed))
    learnt = builder.norm("encoder.beacon_attention.norm", tokens)
    learnt = builder.linear("encoder.beacon_attention.out", learnt)
    places = builder.op("Unsqueeze", "tokens", builder.constant(np.array([1], dtype=np.int64)))
    zeros = builder.op("Mul", nodes, builder.constant(np.array(0.0, dtype=np.float32)))
    return builder.op("Add", nodes, builder.op("ScatterND", zeros, places, learnt))


def detour_bias(builder: Builder) -> str:
    """Return what is added to the logits for the input ``pair_features``, (B, W)."""
    name = "waypoint_decoder.detours"
    flat = builder.reshape("pair_features", -1, PAIR_FEATURES)
    biases = builder.linear(f"{name}.fall", builder.op("Relu", builder.linear(f"{name}.rise", flat)))
    shape = builder.op("Shape", "pair_features")
    both = builder.op("Slice", shape, *(builder.constant(np.array([at], dtype=np.int64)) for at in (0, 2)))
    return builder.op("Reshape", biases, both)
