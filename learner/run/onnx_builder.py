"""ONNX operators for the parts of policy networks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.image_layers import ImageLayer
from common.network.logits import LOGIT_LIMIT
from common.network.parameters import Arrays

_EPSILON = 1e-5


class Builder:
    """Collects operators; each method adds some and returns the name of their result."""

    def __init__(self, config: NetworkConfig, arrays: Arrays, helper: Any, numpy_helper: Any) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.config = config
        self.arrays = arrays
        self._helper = helper
        self._numpy_helper = numpy_helper
        self._count = 0
        self._known: dict[str, str] = {}

    def op(self, kind: str, *inputs: str, name: str | None = None, **attributes: Any) -> str:
        """Add an operator of one output."""
        self._count += 1
        output = name or f"{kind.lower()}_{self._count}"
        self.nodes.append(self._helper.make_node(kind, list(inputs), [output], name=f"n{self._count}", **attributes))
        return output

    def encoder(self, added: str | None = None) -> str:
        """Encode the viewpoints of the inputs ``features`` and ``neighbours``: (N, d).

        Args:
            added: to the embeddings, (N, d).
        """
        # In the place of absent neighbours stands one that is there, with a bias that leaves it a weight of e^-80:
        # nothing beside its own, and no denormal number, with which processors calculate a hundred times as slowly.
        absent = self.op("Less", "neighbours", self.constant(np.array(0, dtype=np.int64)))
        rows = self.op("Where", absent, self.op("ReduceMax", "neighbours", axes=[1], keepdims=1), "neighbours")
        bias = self.op(
            "Where", absent, self.constant(np.array(-80, dtype=np.float32)), self.constant(np.array(0, np.float32))
        )
        bias = self.op("Unsqueeze", bias, self.constant(np.array([1], dtype=np.int64)))  # (N, 1, slots)
        nodes = self.linear("encoder.embedding", "features")
        if added is not None:
            nodes = self.op("Add", nodes, added)
        for layer in range(self.config.layers):
            name = f"encoder.layers.{layer}"
            normed = self.norm(f"{name}.attention_norm", nodes)
            mixed = self._edge_attention(f"{name}.attention", normed, rows, bias)
            nodes = self.op("Add", nodes, self.linear(f"{name}.attention.out", mixed))
            normed = self.norm(f"{name}.feedforward_norm", nodes)
            nodes = self.op("Add", nodes, self.feedforward(f"{name}.feedforward", normed))
        return self.norm("encoder.norm", nodes)

    def _edge_attention(self, name: str, nodes: str, rows: str, bias: str) -> str:
        """Attend from every node over its slots.

        A node asks once for each head, with zeros in place of the other heads' channels: products with whole rows of
        keys and values cost less than cutting these into heads.
        """
        width, heads = self.config.width, self.config.heads
        weight = self.arrays[f"{name}.qkv.weight"]
        query, key, value = (
            self.op("MatMul", nodes, self.constant(part.T))
            for part in (weight[:width] / np.float32(math.sqrt(width // heads)), weight[width:-width], weight[-width:])
        )
        own = self.constant(np.repeat(np.eye(heads, dtype=np.float32), width // heads, axis=1))  # (heads, d)
        between = self.constant(np.array([1], dtype=np.int64))
        asking = self.op("Mul", self.op("Unsqueeze", query, between), own)  # (N, heads, d)
        keys = self.op("Gather", key, rows, axis=0)  # (N, slots, d)
        values = self.op("Gather", value, rows, axis=0)
        scores = self.op("MatMul", asking, self.op("Transpose", keys, perm=[0, 2, 1]))  # (N, heads, slots)
        weights = self.op("Softmax", self.op("Add", scores, bias), axis=-1)
        mixed = self.op("Mul", self.op("MatMul", weights, values), own)  # (N, heads, d)
        return self.op("ReduceSum", mixed, between, keepdims=0)

    def decode(self, decoder: str, queries: str, nodes: str) -> str:
        """Run the decoder layer for queries (Q, d) over all nodes."""
        name, width, heads = f"{decoder}.decoder", self.config.width, self.config.heads
        query_weight = self.arrays[f"{name}.attention.query.weight"] / np.float32(math.sqrt(width // heads))
        kv = self.arrays[f"{name}.attention.kv.weight"]
        normed = self.norm(f"{name}.attention_norm", queries)
        query = self.split_heads(self.op("MatMul", normed, self.constant(query_weight.T)))
        key = self.split_heads(self.op("MatMul", nodes, self.constant(kv[:width].T)))
        value = self.split_heads(self.op("MatMul", nodes, self.constant(kv[width:].T)))
        scores = self.op("MatMul", query, self.op("Transpose", key, perm=[0, 2, 1]))
        mixed = self.join_heads(self.op("MatMul", self.op("Softmax", scores, axis=-1), value))
        queries = self.op("Add", queries, self.linear(f"{name}.attention.out", mixed))
        normed = self.norm(f"{name}.feedforward_norm", queries)
        queries = self.op("Add", queries, self.feedforward(f"{name}.feedforward", normed))
        return self.norm(f"{name}.norm", queries)

    def point(self, decoder: str, asked: str, choices: str, *biases: str) -> str:
        """Return log-probabilities over the choices, (queries, choices); biases of that shape are added to logits."""
        scale = np.float32(math.sqrt(self.config.width))
        query = self.arrays[f"{decoder}.pointer.query.weight"] / scale
        queries = self.op("MatMul", asked, self.constant(query.T))
        keys = self.op("MatMul", choices, self.constant(self.arrays[f"{decoder}.pointer.key.weight"].T))
        scores = self.op("Tanh", self.op("MatMul", queries, self.op("Transpose", keys, perm=[1, 0])))
        limit = self.constant(np.array(LOGIT_LIMIT, dtype=np.float32))
        logits = self.op("Mul", scores, limit)
        for bias in biases:
            logits = self.op("Add", logits, bias)
        return self.op("LogSoftmax", logits, axis=-1)

    def linear(self, name: str, inputs: str) -> str:
        """Apply a linear map to (items, inputs)."""
        weight = self.constant(self.arrays[f"{name}.weight"].T)
        return self.op("Gemm", inputs, weight, self.constant(self.arrays[f"{name}.bias"]))

    def convolution(self, name: str, layer: ImageLayer, images: str) -> str:
        """Apply a convolution and a ReLU to (k, inputs, side, side)."""
        kernel = self.arrays[f"{name}.weight"].reshape(layer.outputs, layer.inputs, layer.side, layer.side)
        bias = self.constant(self.arrays[f"{name}.bias"])
        strides, pads = [layer.stride] * 2, [layer.padding] * 4
        return self.op("Relu", self.op("Conv", images, self.constant(kernel), bias, strides=strides, pads=pads))

    def feedforward(self, name: str, inputs: str) -> str:
        """Apply a feed-forward block to (items, d)."""
        return self.linear(f"{name}.fall", self.op("Relu", self.linear(f"{name}.rise", inputs)))

    def norm(self, name: str, inputs: str) -> str:
        """Apply a layer norm to (items, d)."""
        gain, shift = self.constant(self.arrays[f"{name}.weight"]), self.constant(self.arrays[f"{name}.bias"])
        return self.op("LayerNormalization", inputs, gain, shift, axis=-1, epsilon=_EPSILON)

    def split_heads(self, items: str) -> str:
        """Turn (items, d) into (heads, items, channels)."""
        heads = self.config.heads
        return self.op("Transpose", self.reshape(items, -1, heads, self.config.width // heads), perm=[1, 0, 2])

    def join_heads(self, items: str) -> str:
        """Turn (heads, items, channels) into (items, d)."""
        return self.reshape(self.op("Transpose", items, perm=[1, 0, 2]), -1, self.config.width)

    def reshape(self, items: str, *shape: int) -> str:
        """Return the same numbers in another shape."""
        return self.op("Reshape", items, self.constant(np.array(shape, dtype=np.int64)))

    def constant(self, values: NDArray[Any]) -> str:
        """Add a constant; small ones (shapes, numbers) are shared."""
        values = np.ascontiguousarray(values)
        key = f"{values.dtype}{values.shape}{values.tolist()}" if values.size < 8 else f"large{len(self.constants)}"
        if key not in self._known:
            self._known[key] = f"c{len(self.constants)}"
            self.constants.append(self._numpy_helper.from_array(values, self._known[key]))
        return self._known[key]
