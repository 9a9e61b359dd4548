"""The policy network in ONNX Runtime: the third of three equivalent implementations (torch, numpy, ONNX)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import CheckpointError
from common.network.graph_arrays import GraphArrays
from common.observations.index import EXTRA_SLOTS
from common.observations.overview import CLOSENESS, PAIR_FEATURES
from common.system.extras import optional

Array = NDArray[np.float32]


class OnnxNetwork:
    """Encoder and decoders over one observation, called as the networks of `common.network.inference` are.

    Args:
        model: a serialised model, as `learner.run.onnx_model` describes it.
        threads: that a decision may use.

    Raises:
        CheckpointError: onnxruntime cannot run this model, or the model is of an earlier release and takes graphs of
            a fixed number of neighbours.
        MissingPackageError: onnxruntime is not installed.
    """

    def __init__(self, model: bytes, threads: int = 1) -> None:
        with optional("a policy in an .onnx file", "onnx", instead="use the policy's .safetensors file"):
            import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        try:
            self._session: Any = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        # onnxruntime raises errors of its own kinds, which share no base but Exception.
        except Exception as error:
            raise CheckpointError(f"onnxruntime {onnxruntime.__version__} cannot run this model: {error}") from error
        inputs = {each.name: each.shape for each in self._session.get_inputs()}
        shape = inputs.get("neighbours")
        if shape and isinstance(shape[-1], int):
            raise CheckpointError(
                f"this ONNX model is of an earlier release, in which a viewpoint had {shape[-1] - EXTRA_SLOTS} "
                "neighbours at most: export the policy again with `hd-learner export --format onnx`, or use its "
                ".safetensors file"
            )
        self._inputs = set(inputs)

    def __call__(self, graph: GraphArrays) -> tuple[Array, Array]:
        """Return log π_b, shape (beacons,), and log π_a given each beacon, shape (beacons, waypoints).

        Args:
            graph: exactly one observation, with at least one beacon and one waypoint.
        """
        tokens, beacons = len(graph.token_rows), len(graph.beacon_rows)
        feed: dict[str, NDArray[Any] | None] = {
            "features": graph.features,
            "neighbours": graph.neighbours.astype(np.int64),
            "robot": graph.robot_rows,
            "beacons": graph.beacon_rows,
            "waypoints": graph.waypoint_rows,
            "toward": graph.toward.reshape(beacons, -1),
            "image": None if graph.image is None else graph.image[0],
            "steps": graph.waypoint_steps,
            "raster": graph.raster[0] if len(graph.raster) else None,
            "cells": graph.cells,
            "tokens": graph.token_rows,
            "closeness": graph.closeness.reshape(tokens, tokens, CLOSENESS),
            "pair_features": graph.pair_features.reshape(beacons, -1, PAIR_FEATURES),
        }
        log_beacon, log_waypoint = self._session.run(
            ["log_beacon", "log_waypoint"], {name: array for name, array in feed.items() if name in self._inputs}
        )
        return log_beacon, log_waypoint
