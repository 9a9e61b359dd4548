"""What `Convolution` says, in numpy. Channels run fastest here, so that whole pixels are copied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.network.image_layers import ImageLayer
from common.network.parameters import Arrays

Array = NDArray[np.float32]


class ConvolutionInference:
    """A convolution and a ReLU.

    Args:
        layer: its shape.
        arrays: weights of the network.
        name: of this convolution's weights among them.
    """

    def __init__(self, layer: ImageLayer, arrays: Arrays, name: str) -> None:
        self._layer = layer
        kernel = arrays[f"{name}.weight"].reshape(layer.outputs, layer.inputs, layer.side, layer.side)
        self._weight = np.ascontiguousarray(kernel.transpose(2, 3, 1, 0).reshape(-1, layer.outputs))
        self._bias = arrays[f"{name}.bias"]

    def __call__(self, images: Array) -> Array:
        """Map images (k, side, side, inputs) to (k, result, result, outputs)."""
        layer = self._layer
        count, side = images.shape[:2]
        padded = np.zeros((count, side + 2 * layer.padding, side + 2 * layer.padding, layer.inputs), dtype=np.float32)
        padded[:, layer.padding : layer.padding + side, layer.padding : layer.padding + side] = images
        patches = np.empty((count, layer.result, layer.result, layer.side, layer.side, layer.inputs), dtype=np.float32)
        reach = layer.stride * (layer.result - 1) + 1
        for row in range(layer.side):
            for column in range(layer.side):
                part = padded[:, row : row + reach : layer.stride, column : column + reach : layer.stride]
                patches[:, :, :, row, column] = part
        made = patches.reshape(-1, len(self._weight)) @ self._weight
        made += self._bias
        np.maximum(made, np.float32(0.0), out=made)
        return made.reshape(count, layer.result, layer.result, layer.outputs)
