"""A policy as an ONNX graph, written operator by operator from its weights."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.parameters import Arrays
from common.observations.features import feature_count
from common.system.extras import optional

ValueInfo = tuple[str, Any, list[str | int]]

OPSET = 17
_EPSILON = 1e-5
_LOGIT_LIMIT = 10.0


def onnx_model(config: NetworkConfig, arrays: Arrays) -> bytes:
    """Return a policy as a serialised ONNX model of one observation, opset 17.

    Inputs, of any number N of nodes, S of slots for neighbours, B of beacons and W of waypoints:

    - ``features``: float32, (N, F), see `common.observations.features`;
    - ``neighbours``: int64, (N, S), rows that a node attends to, -1 where absent, as in `GraphArrays`;
    - ``robot``: int64, (1,), row of the robot's node;
    - ``beacons``: int64, (B,), rows of the beacons; not there in `vanilla`;
    - ``waypoints``: int64, (W,), rows of the waypoints;
    - ``toward``: float32, (B, W), see `GraphArrays`; where the network reads it.

    Outputs: ``log_beacon``, float32, (B,), and ``log_waypoint``, float32, (B, W); B is 1 in `vanilla`.

    Args:
        config: the network's configuration.
        arrays: its weights, as `common.network.parameters` names them.

    Raises:
        MissingPackageError: the package onnx is not installed.
    """
    with optional("writing ONNX", "onnx", instead="export to .safetensors"):
        import onnx

    builder = _Builder(config, arrays, onnx.helper, onnx.numpy_helper)
    log_beacon, log_waypoint = builder.policy()
    builder.op("Identity", log_beacon, name="log_beacon")
    builder.op("Identity", log_waypoint, name="log_waypoint")
    number, floats = onnx.TensorProto.INT64, onnx.TensorProto.FLOAT
    beacons = "B" if builder.hierarchical else 1
    beacon_rows: list[ValueInfo] = [("beacons", number, ["B"])] if builder.hierarchical else []
    toward: list[ValueInfo] = [("toward", floats, [beacons, "W"])] if config.toward else []
    inputs: list[ValueInfo] = [
        ("features", floats, ["N", feature_count(config.features)]),
        ("neighbours", number, ["N", "S"]),
        ("robot", number, [1]),
        *beacon_rows,
        ("waypoints", number, ["W"]),
        *toward,
    ]
    outputs: list[ValueInfo] = [
        ("log_beacon", floats, [beacons]),
        ("log_waypoint", floats, [beacons, "W"]),
    ]
    graph = onnx.helper.make_graph(
        builder.nodes,
        "policy",
        [onnx.helper.make_tensor_value_info(name, kind, shape) for name, kind, shape in inputs],
        [onnx.helper.make_tensor_value_info(name, kind, shape) for name, kind, shape in outputs],
        builder.constants,
    )
    model = onnx.helper.make_model(
        graph,
        producer_name="hdplanner",
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        # Runtimes of two years ago read this version of the format.
        ir_version=8,
    )
    onnx.checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString()
    return data


class _Builder:
    """Collects operators; each method adds some and returns the name of their result."""

    def __init__(self, config: NetworkConfig, arrays: Arrays, helper: Any, numpy_helper: Any) -> None:
        self.hierarchical = config.variant != "vanilla"
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self._config = config
        self._arrays = arrays
        self._helper = helper
        self._numpy_helper = numpy_helper
        self._count = 0
        self._known: dict[str, str] = {}

    def policy(self) -> tuple[str, str]:
        """Add the whole network and return log π_b and log π_a."""
        nodes = self._encoder()
        robot = self.op("Gather", nodes, "robot", axis=0)
        asking = robot
        log_beacon = self._constant(np.zeros(1, dtype=np.float32))
        if self.hierarchical:
            beacons = self.op("Gather", nodes, "beacons", axis=0)
            asked = self._decode("beacon_decoder", robot, nodes)
            log_beacon = self._flat(self._point("beacon_decoder", asked, beacons))
            repeated = self.op("Expand", robot, self.op("Shape", beacons))
            asking = self.op("Concat", beacons, repeated, axis=1)
        waypoints = self.op("Gather", nodes, "waypoints", axis=0)
        asked = self._decode("waypoint_decoder", self._linear("waypoint_decoder.join", asking), nodes)
        bias = None
        if self._config.toward:
            bias = self.op("Mul", "toward", self._constant(self._arrays["waypoint_decoder.toward"]))
        return log_beacon, self._point("waypoint_decoder", asked, waypoints, bias)

    def op(self, kind: str, *inputs: str, name: str | None = None, **attributes: Any) -> str:
        """Add an operator of one output."""
        self._count += 1
        output = name or f"{kind.lower()}_{self._count}"
        self.nodes.append(self._helper.make_node(kind, list(inputs), [output], name=f"n{self._count}", **attributes))
        return output

    def _encoder(self) -> str:
        rows = self.op("Max", "neighbours", self._constant(np.array(0, dtype=np.int64)))
        absent = self.op("Less", "neighbours", self._constant(np.array(0, dtype=np.int64)))
        # Added to the scores of absent neighbours, whose weight becomes exactly 0.
        bias = self.op(
            "Where", absent, self._constant(np.array(-1e9, dtype=np.float32)), self._constant(np.array(0, np.float32))
        )
        bias = self.op("Unsqueeze", bias, self._constant(np.array([0, 2], dtype=np.int64)))  # (1, N, 1, slots)
        nodes = self._linear("encoder.embedding", "features")
        for layer in range(self._config.layers):
            name = f"encoder.layers.{layer}"
            normed = self._norm(f"{name}.attention_norm", nodes)
            mixed = self._edge_attention(f"{name}.attention", normed, rows, bias)
            nodes = self.op("Add", nodes, self._linear(f"{name}.attention.out", mixed))
            normed = self._norm(f"{name}.feedforward_norm", nodes)
            nodes = self.op("Add", nodes, self._feedforward(f"{name}.feedforward", normed))
        return self._norm("encoder.norm", nodes)

    def _edge_attention(self, name: str, nodes: str, rows: str, bias: str) -> str:
        """Attend from every node over its slots; heads come first, so that whole blocks are gathered."""
        width, heads = self._config.width, self._config.heads
        weight = self._arrays[f"{name}.qkv.weight"]
        query, key, value = (
            self._split_heads(self.op("MatMul", nodes, self._constant(part.T)))
            for part in (weight[:width] / np.float32(math.sqrt(width // heads)), weight[width:-width], weight[-width:])
        )
        keys = self.op("Gather", key, rows, axis=1)  # (heads, N, slots, channels)
        values = self.op("Gather", value, rows, axis=1)
        query = self.op("Unsqueeze", query, self._constant(np.array([2], dtype=np.int64)))
        scores = self.op("MatMul", query, self.op("Transpose", keys, perm=[0, 1, 3, 2]))  # (heads, N, 1, slots)
        weights = self.op("Softmax", self.op("Add", scores, bias), axis=-1)
        mixed = self.op("MatMul", weights, values)
        return self._join_heads(self._reshape(mixed, heads, -1, width // heads))

    def _decode(self, decoder: str, queries: str, nodes: str) -> str:
        """Run the decoder layer for queries (Q, d) over all nodes."""
        name, width, heads = f"{decoder}.decoder", self._config.width, self._config.heads
        query_weight = self._arrays[f"{name}.attention.query.weight"] / np.float32(math.sqrt(width // heads))
        kv = self._arrays[f"{name}.attention.kv.weight"]
        normed = self._norm(f"{name}.attention_norm", queries)
        query = self._split_heads(self.op("MatMul", normed, self._constant(query_weight.T)))
        key = self._split_heads(self.op("MatMul", nodes, self._constant(kv[:width].T)))
        value = self._split_heads(self.op("MatMul", nodes, self._constant(kv[width:].T)))
        scores = self.op("MatMul", query, self.op("Transpose", key, perm=[0, 2, 1]))
        mixed = self._join_heads(self.op("MatMul", self.op("Softmax", scores, axis=-1), value))
        queries = self.op("Add", queries, self._linear(f"{name}.attention.out", mixed))
        normed = self._norm(f"{name}.feedforward_norm", queries)
        queries = self.op("Add", queries, self._feedforward(f"{name}.feedforward", normed))
        return self._norm(f"{name}.norm", queries)

    def _point(self, decoder: str, asked: str, choices: str, bias: str | None = None) -> str:
        """Return log-probabilities over the choices, (queries, choices)."""
        scale = np.float32(math.sqrt(self._config.width))
        query = self._arrays[f"{decoder}.pointer.query.weight"] / scale
        queries = self.op("MatMul", asked, self._constant(query.T))
        keys = self.op("MatMul", choices, self._constant(self._arrays[f"{decoder}.pointer.key.weight"].T))
        scores = self.op("Tanh", self.op("MatMul", queries, self.op("Transpose", keys, perm=[1, 0])))
        limit = self._constant(np.array(_LOGIT_LIMIT, dtype=np.float32))
        logits = self.op("Mul", scores, limit)
        return self.op("LogSoftmax", logits if bias is None else self.op("Add", logits, bias), axis=-1)

    def _linear(self, name: str, inputs: str) -> str:
        weight = self._constant(self._arrays[f"{name}.weight"].T)
        return self.op("Gemm", inputs, weight, self._constant(self._arrays[f"{name}.bias"]))

    def _feedforward(self, name: str, inputs: str) -> str:
        return self._linear(f"{name}.fall", self.op("Relu", self._linear(f"{name}.rise", inputs)))

    def _norm(self, name: str, inputs: str) -> str:
        gain, shift = self._constant(self._arrays[f"{name}.weight"]), self._constant(self._arrays[f"{name}.bias"])
        return self.op("LayerNormalization", inputs, gain, shift, axis=-1, epsilon=_EPSILON)

    def _split_heads(self, items: str) -> str:
        """Turn (items, d) into (heads, items, channels)."""
        heads = self._config.heads
        return self.op("Transpose", self._reshape(items, -1, heads, self._config.width // heads), perm=[1, 0, 2])

    def _join_heads(self, items: str) -> str:
        return self._reshape(self.op("Transpose", items, perm=[1, 0, 2]), -1, self._config.width)

    def _flat(self, items: str) -> str:
        return self._reshape(items, -1)

    def _reshape(self, items: str, *shape: int) -> str:
        return self.op("Reshape", items, self._constant(np.array(shape, dtype=np.int64)))

    def _constant(self, values: NDArray[Any]) -> str:
        """Add a constant; small ones (shapes, numbers) are shared."""
        values = np.ascontiguousarray(values)
        key = f"{values.dtype}{values.shape}{values.tolist()}" if values.size < 8 else f"large{len(self.constants)}"
        if key not in self._known:
            self._known[key] = f"c{len(self.constants)}"
            self.constants.append(self._numpy_helper.from_array(values, self._known[key]))
        return self._known[key]
