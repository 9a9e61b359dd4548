"""A policy as an ONNX graph, written operator by operator from its weights."""

from __future__ import annotations

from typing import Any

import numpy as np

from common.config import NetworkConfig
from common.network.image_layers import TABLE_SIDE, image_layers
from common.network.logits import LOGIT_LIMIT
from common.network.parameters import Arrays
from common.observations.belief_raster import RASTER_CHANNELS, RASTER_SIDE
from common.observations.feature_sets import feature_count
from common.observations.observation import IMAGE_SIDE, IMAGES
from common.observations.overview import CLOSENESS, PAIR_FEATURES
from common.system.extras import optional
from learner.run.onnx_belief import belief_values
from learner.run.onnx_builder import Builder
from learner.run.onnx_overview import beacon_attention, detour_bias

ValueInfo = tuple[str, Any, list[str | int]]

OPSET = 17


def onnx_model(config: NetworkConfig, arrays: Arrays) -> bytes:
    """Return a policy as a serialised ONNX model of one observation, opset 17.

    Inputs, of any number N of nodes, S of slots for neighbours, B of beacons and W of waypoints:

    - ``features``: float32, (N, F), see `common.observations.features`;
    - ``neighbours``: int64, (N, S), rows that a node attends to, -1 where absent, as in `GraphArrays`;
    - ``robot``: int64, (1,), row of the robot's node;
    - ``beacons``: int64, (B,), rows of the beacons; only where beacons are chosen;
    - ``waypoints``: int64, (W,), rows of the waypoints;
    - ``toward``: float32, (B, W), see `GraphArrays`; where the network reads it, as the following;
    - ``raster``: float32, (2, C, side, side), and ``cells``: int64, (N,), see `common.observations.belief_raster`;
    - ``tokens``: int64, (T,), rows of robot, beacons and target, ascending;
    - ``closeness``: float32, (T, T, 5), how close they are to one another;
    - ``pair_features``: float32, (B, W, 5), how each waypoint lies to each beacon.

    The variant `cnn` takes the image of an observation instead, ``image``: uint8, (2, pixels), and ``steps``: float32,
    (W, 2), offsets of the waypoints from the robot in lattice steps.

    Outputs: ``log_beacon``, float32, (B,), and ``log_waypoint``, float32, (B, W); B is 1 where no beacon is chosen.

    Args:
        config: the network's configuration.
        arrays: its weights, as `common.network.parameters` names them.

    Raises:
        MissingPackageError: the package onnx is not installed.
    """
    with optional("writing ONNX", "onnx", instead="export to .safetensors"):
        import onnx

    builder = Builder(config, arrays, onnx.helper, onnx.numpy_helper)
    number, floats, byte = onnx.TensorProto.INT64, onnx.TensorProto.FLOAT, onnx.TensorProto.UINT8
    beacons: str | int = "B" if config.hierarchical else 1
    if config.variant == "cnn":
        log_beacon, log_waypoint = _image_policy(builder)
        inputs: list[ValueInfo] = [
            ("image", byte, [len(IMAGES), IMAGE_SIDE**2]),
            ("steps", floats, ["W", 2]),
        ]
    else:
        log_beacon, log_waypoint = _graph_policy(builder)
        inputs = [
            ("features", floats, ["N", feature_count(config.features)]),
            ("neighbours", number, ["N", "S"]),
            ("robot", number, [1]),
            ("waypoints", number, ["W"]),
        ]
        if config.hierarchical:
            inputs.insert(3, ("beacons", number, ["B"]))
        if config.toward:
            inputs.append(("toward", floats, [beacons, "W"]))
        if config.belief_map:
            inputs.append(("raster", floats, [len(IMAGES), RASTER_CHANNELS, RASTER_SIDE, RASTER_SIDE]))
            inputs.append(("cells", number, ["N"]))
        if config.beacon_attention:
            inputs += [("tokens", number, ["T"]), ("closeness", floats, ["T", "T", CLOSENESS])]
        if config.detours:
            inputs.append(("pair_features", floats, ["B", "W", PAIR_FEATURES]))
    builder.op("Identity", log_beacon, name="log_beacon")
    builder.op("Identity", log_waypoint, name="log_waypoint")
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


def _graph_policy(builder: Builder) -> tuple[str, str]:
    """Add a whole network over viewpoints and return log π_b and log π_a."""
    config = builder.config
    nodes = builder.encoder(belief_values(builder) if config.belief_map else None)
    if config.beacon_attention:
        nodes = beacon_attention(builder, nodes)
    robot = builder.op("Gather", nodes, "robot", axis=0)
    waypoints = builder.op("Gather", nodes, "waypoints", axis=0)
    log_beacon = builder.constant(np.zeros(1, dtype=np.float32))
    if config.baseline:
        asked = builder.decode("waypoint_decoder", robot, nodes)
        asked = builder.linear("waypoint_decoder.join", builder.op("Concat", asked, robot, axis=1))
        return log_beacon, builder.point("waypoint_decoder", asked, waypoints)
    asking = robot
    if config.hierarchical:
        beacons = builder.op("Gather", nodes, "beacons", axis=0)
        asked = builder.decode("beacon_decoder", robot, nodes)
        log_beacon = builder.reshape(builder.point("beacon_decoder", asked, beacons), -1)
        repeated = builder.op("Expand", robot, builder.op("Shape", beacons))
        asking = builder.op("Concat", beacons, repeated, axis=1)
    asked = builder.decode("waypoint_decoder", builder.linear("waypoint_decoder.join", asking), nodes)
    biases = []
    if config.toward:
        biases.append(builder.op("Mul", "toward", builder.constant(builder.arrays["waypoint_decoder.toward"])))
    if config.detours:
        biases.append(detour_bias(builder))
    return log_beacon, builder.point("waypoint_decoder", asked, waypoints, *biases)


def _image_policy(builder: Builder) -> tuple[str, str]:
    """Add a whole network over images and return log π_b and log π_a."""
    import onnx

    def number(value: float) -> str:
        return builder.constant(np.array(value, dtype=np.float32))

    pixels = builder.op("Cast", "image", to=onnx.TensorProto.FLOAT)
    free = builder.op("Floor", builder.op("Div", pixels, number(16.0)))
    occupied = builder.op("Sub", pixels, builder.op("Mul", free, number(16.0)))
    # (images, channels, pixels)
    axis = builder.constant(np.array([1], dtype=np.int64))
    channels = builder.op("Concat", *(builder.op("Unsqueeze", each, axis) for each in (free, occupied)), axis=1)
    shares = builder.reshape(builder.op("Div", channels, number(15.0)), len(IMAGES), 2, IMAGE_SIDE, IMAGE_SIDE)
    encoded = []
    for place, name in enumerate(IMAGES):
        image = builder.op("Gather", shares, builder.constant(np.array([place], dtype=np.int64)), axis=0)
        for layer in image_layers(builder.config):
            image = builder.convolution(f"encoder.{name}.{layer.name}", layer, image)
        encoded.append(builder.reshape(image, 1, -1))
    hidden = builder.op("Relu", builder.linear("table.join", builder.op("Concat", *encoded, axis=1)))
    table = builder.reshape(builder.linear("table.values", hidden), TABLE_SIDE, TABLE_SIDE)
    # The tents of `common.network.image_inference.place_tents`, along x and along y.
    middle = TABLE_SIDE // 2
    steps = builder.op("Clip", "steps", number(-middle), number(middle))
    places = builder.constant(np.arange(-middle, middle + 1, dtype=np.float32))
    along = []
    for axis_number in range(2):
        step = builder.op("Gather", steps, builder.constant(np.array([axis_number], dtype=np.int64)), axis=1)
        beside = builder.op("Abs", builder.op("Sub", step, places))
        along.append(builder.op("Relu", builder.op("Sub", number(1.0), beside)))
    read = builder.op("Mul", builder.op("MatMul", along[1], table), along[0])
    values = builder.op("ReduceSum", read, builder.constant(np.array([1], dtype=np.int64)), keepdims=0)
    limit = number(LOGIT_LIMIT)
    logits = builder.op("Mul", builder.op("Tanh", builder.op("Div", values, limit)), limit)
    log_waypoint = builder.op("LogSoftmax", builder.reshape(logits, 1, -1), axis=-1)
    return builder.constant(np.zeros(1, dtype=np.float32)), log_waypoint
