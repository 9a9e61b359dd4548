"""What `BeliefMap` says of one observation, in numpy; see `common.network.inference`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.belief_layers import belief_layers
from common.network.graph_arrays import GraphArrays
from common.network.image_layers import ImageLayer
from common.network.parameters import Arrays

Array = NDArray[np.float32]


class BeliefInference:
    """The U-Net over the belief of one observation. Channels run fastest here, so that whole pixels are copied.

    Args:
        config: the network's configuration.
        arrays: its weights, checked by the caller.
    """

    def __init__(self, config: NetworkConfig, arrays: Arrays) -> None:
        self._layers = belief_layers(config)
        self._weights: dict[str, tuple[Array, Array]] = {}
        for layer in self._layers:
            name = f"encoder.belief_map.{layer.name}"
            kernel = arrays[f"{name}.weight"].reshape(layer.outputs, layer.inputs, layer.side, layer.side)
            matrix = kernel.transpose(2, 3, 1, 0).reshape(-1, layer.outputs)
            self._weights[layer.name] = np.ascontiguousarray(matrix), arrays[f"{name}.bias"]
        self._out = np.ascontiguousarray(arrays["encoder.belief_map.out.weight"].T)

    def __call__(self, graph: GraphArrays) -> Array:
        """Return what is added to the embeddings of the nodes of exactly one observation, shape (nodes, d)."""
        layers = self._layers
        fine = self._apply(layers.down_0, graph.raster[0].transpose(0, 2, 3, 1))
        half = self._apply(layers.down_1, fine)
        found = self._apply(layers.bottom, self._apply(layers.down_2, half))
        found = self._apply(layers.up_1, np.concatenate([_doubled(found), half], axis=3))
        found = self._apply(layers.up_0, np.concatenate([_doubled(found), fine], axis=3))
        values = found.reshape(-1, layers.up_0.outputs)
        shown = np.zeros((len(graph.cells), values.shape[1]), dtype=np.float32)
        inside = graph.cells < len(values)
        shown[inside] = values[graph.cells[inside]]
        added: Array = shown @ self._out
        return added

    def _apply(self, layer: ImageLayer, images: Array) -> Array:
        """Apply a convolution and a ReLU to images (k, side, side, inputs)."""
        count, side = images.shape[:2]
        padded = np.zeros((count, side + 2 * layer.padding, side + 2 * layer.padding, layer.inputs), dtype=np.float32)
        padded[:, layer.padding : layer.padding + side, layer.padding : layer.padding + side] = images
        patches = np.empty((count, layer.result, layer.result, layer.side, layer.side, layer.inputs), dtype=np.float32)
        reach = layer.stride * (layer.result - 1) + 1
        for row in range(layer.side):
            for column in range(layer.side):
                part = padded[:, row : row + reach : layer.stride, column : column + reach : layer.stride]
                patches[:, :, :, row, column] = part
        weight, bias = self._weights[layer.name]
        made = patches.reshape(-1, len(weight)) @ weight
        made += bias
        np.maximum(made, np.float32(0.0), out=made)
        return made.reshape(count, layer.result, layer.result, layer.outputs)


def _doubled(images: Array) -> Array:
    doubled: Array = images.repeat(2, axis=1).repeat(2, axis=2)
    return doubled
