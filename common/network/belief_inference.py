"""What `BeliefMap` says of one observation, in numpy; see `common.network.inference`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from common.network.belief_layers import BeliefLayers
from common.network.graph_arrays import GraphArrays
from common.network.image_inference import convolve
from common.network.image_layers import ImageLayer
from common.observations.belief_raster import RASTER_CHANNELS, RASTER_SIDE

Array = NDArray[np.float32]


def belief_values(weights: Mapping[str, Array], layers: BeliefLayers, graph: GraphArrays) -> Array:
    """Return what is added to the embeddings of the nodes of one observation, shape (nodes, d).

    Args:
        weights: linear maps and convolutions laid out (inputs, outputs).
        layers: of the network.
        graph: the observation.
    """

    def applied(layer: ImageLayer, images: Array) -> Array:
        name = f"encoder.belief_map.{layer.name}"
        return convolve(layer, images, weights[f"{name}.weight"], weights[f"{name}.bias"])

    fine = applied(layers.down_0, graph.raster.reshape(-1, RASTER_CHANNELS, RASTER_SIDE, RASTER_SIDE))
    half = applied(layers.down_1, fine)
    found = applied(layers.bottom, applied(layers.down_2, half))
    found = applied(layers.up_1, np.concatenate([_doubled(found), half], axis=1))
    found = applied(layers.up_0, np.concatenate([_doubled(found), fine], axis=1))
    values = found.transpose(0, 2, 3, 1).reshape(-1, layers.up_0.outputs)
    shown = np.zeros((len(graph.cells), values.shape[1]), dtype=np.float32)
    inside = graph.cells < len(values)
    shown[inside] = values[graph.cells[inside]]
    added: Array = shown @ weights["encoder.belief_map.out.weight"]
    return added


def _doubled(images: Array) -> Array:
    doubled: Array = images.repeat(2, axis=2).repeat(2, axis=3)
    return doubled
