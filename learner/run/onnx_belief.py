"""ONNX operators for the U-Net over the belief."""

from __future__ import annotations

import numpy as np

from common.network.belief_layers import belief_layers
from common.network.image_layers import ImageLayer
from learner.run.onnx_builder import Builder


def belief_values(builder: Builder) -> str:
    """Return what is added to the embeddings for the inputs ``raster`` and ``cells``, (N, d)."""
    layers = belief_layers(builder.config)

    def applied(layer: ImageLayer, images: str) -> str:
        return builder.convolution(f"encoder.belief_map.{layer.name}", layer, images)

    def doubled(images: str) -> str:
        scales = builder.constant(np.array([1.0, 1.0, 2.0, 2.0], dtype=np.float32))
        kind = {"mode": "nearest", "nearest_mode": "floor", "coordinate_transformation_mode": "asymmetric"}
        return builder.op("Resize", images, "", scales, **kind)

    fine = applied(layers.down_0, "raster")
    half = applied(layers.down_1, fine)
    found = applied(layers.bottom, applied(layers.down_2, half))
    found = applied(layers.up_1, builder.op("Concat", doubled(found), half, axis=1))
    found = applied(layers.up_0, builder.op("Concat", doubled(found), fine, axis=1))
    channels = layers.up_0.outputs
    values = builder.reshape(builder.op("Transpose", found, perm=[0, 2, 3, 1]), -1, channels)
    # The last row is that of nodes which no image shows.
    values = builder.op("Concat", values, builder.constant(np.zeros((1, channels), dtype=np.float32)), axis=0)
    shown = builder.op("Gather", values, "cells", axis=0)
    return builder.op("MatMul", shown, builder.constant(builder.arrays["encoder.belief_map.out.weight"].T))
