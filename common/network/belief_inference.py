"""What `BeliefMap` says of one observation, in numpy; see `common.network.inference`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.belief_layers import belief_layers
from common.network.convolution_inference import ConvolutionInference
from common.network.graph_arrays import GraphArrays
from common.network.parameters import Arrays

Array = NDArray[np.float32]


class BeliefInference:
    """The U-Net over the belief of one observation.

    Args:
        config: the network's configuration.
        arrays: its weights, checked by the caller.
    """

    def __init__(self, config: NetworkConfig, arrays: Arrays) -> None:
        self._layers = belief_layers(config)
        self._convolutions = {
            layer: ConvolutionInference(layer, arrays, f"encoder.belief_map.{layer.name}") for layer in self._layers
        }
        self._out = np.ascontiguousarray(arrays["encoder.belief_map.out.weight"].T)

    def __call__(self, graph: GraphArrays) -> Array:
        """Return what is added to the embeddings of the nodes of exactly one observation, shape (nodes, d)."""
        layers, apply = self._layers, self._convolutions
        fine = apply[layers.down_0](graph.raster[0].transpose(0, 2, 3, 1))
        half = apply[layers.down_1](fine)
        found = apply[layers.bottom](apply[layers.down_2](half))
        found = apply[layers.up_1](np.concatenate([_doubled(found), half], axis=3))
        found = apply[layers.up_0](np.concatenate([_doubled(found), fine], axis=3))
        values = found.reshape(-1, layers.up_0.outputs)
        shown = np.zeros((len(graph.cells), values.shape[1]), dtype=np.float32)
        inside = graph.cells < len(values)
        shown[inside] = values[graph.cells[inside]]
        added: Array = shown @ self._out
        return added


def _doubled(images: Array) -> Array:
    doubled: Array = images.repeat(2, axis=1).repeat(2, axis=2)
    return doubled
