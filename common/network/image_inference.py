"""The network over images for one observation at a time, in numpy; see `common.network.image_network`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.convolution_inference import ConvolutionInference
from common.network.graph_arrays import GraphArrays
from common.network.image_layers import TABLE_SIDE, image_layers
from common.network.logits import LOGIT_LIMIT, log_softmax
from common.network.parameters import Arrays
from common.observations.observation import IMAGE_SIDE, IMAGES

Array = NDArray[np.float32]


class ImageInference:
    """Convolutions over the images of one observation, and the values of its waypoints.

    Args:
        config: the network's configuration.
        arrays: its weights, checked by the caller.
    """

    def __init__(self, config: NetworkConfig, arrays: Arrays) -> None:
        layers = image_layers(config)
        self._encoders = {
            name: [ConvolutionInference(layer, arrays, f"encoder.{name}.{layer.name}") for layer in layers]
            for name in IMAGES
        }
        # Linear maps multiply from the right, so their weights are laid out (inputs, outputs).
        self._weights = {name: np.ascontiguousarray(value.T) for name, value in arrays.items()}

    def __call__(self, graph: GraphArrays) -> tuple[Array, Array]:
        """Return log π_b, shape (1,), and log π_a, shape (1, waypoints), of exactly one observation with a waypoint."""
        assert graph.image is not None, "the arrays were made for this network"
        encoded = [self._encode(name, image) for name, image in zip(IMAGES, graph.image[0], strict=True)]
        hidden = np.maximum(self._linear("table.join", np.concatenate(encoded)[None]), np.float32(0.0))
        table = self._linear("table.values", hidden).reshape(TABLE_SIDE, TABLE_SIDE)
        tents = place_tents(graph.waypoint_steps)
        values = ((tents[:, 1] @ table) * tents[:, 0]).sum(axis=1)
        logits = np.float32(LOGIT_LIMIT) * np.tanh(values / np.float32(LOGIT_LIMIT))
        return np.zeros(1, dtype=np.float32), log_softmax(logits[None])

    def _encode(self, name: str, image: NDArray[np.uint8]) -> Array:
        """Return the features of one image, shape (values,)."""
        images = np.stack([image >> 4, image & 15], axis=1).astype(np.float32) / np.float32(15.0)
        images = images.reshape(1, IMAGE_SIDE, IMAGE_SIDE, 2)
        for convolution in self._encoders[name]:
            images = convolution(images)
        # The channels come first in the maps that follow.
        return images[0].transpose(2, 0, 1).reshape(-1)

    def _linear(self, name: str, inputs: Array) -> Array:
        return inputs @ self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"]


def place_tents(steps: Array) -> Array:
    """Return by how much each place of the table counts for each waypoint, along x and y.

    Args:
        steps: of the waypoints from the robot, lattice steps, shape (n, 2).

    Returns:
        1 at a place, falling to 0 at the next one, float32, shape (n, 2, side).
    """
    middle = TABLE_SIDE // 2
    places = np.arange(-middle, middle + 1, dtype=np.float32)
    beside = np.abs(np.clip(steps, -middle, middle)[:, :, None] - places)
    return np.maximum(np.float32(1.0) - beside, np.float32(0.0))
