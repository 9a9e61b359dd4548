"""The shape of the network over images, shared by its three implementations (torch, numpy, ONNX)."""

from __future__ import annotations

from typing import Final, NamedTuple

from common.config import NetworkConfig
from common.observations.observation import IMAGE_SIDE

TABLE_SIDE: Final = 5
"""Places that the network values lie up to two lattice steps from the robot along each axis, as its neighbours do."""
CHANNELS: Final = 2
"""Of an image: what is free, and what is occupied."""


class ImageLayer(NamedTuple):
    """A convolution and a ReLU.

    Attributes:
        name: of its weights, which are a matrix (outputs, inputs * side * side).
        inputs: channels that it reads.
        outputs: channels that it makes.
        side: of its kernel.
        stride: of its kernel.
        result: side of what it makes.
        padding: zeros around what it reads.
    """

    name: str
    inputs: int
    outputs: int
    side: int
    stride: int
    result: int
    padding: int = 0

    @property
    def values(self) -> int:
        """Numbers that it makes of an image."""
        return self.outputs * self.result**2


def image_layers(config: NetworkConfig) -> list[ImageLayer]:
    """Return the convolutions over one image; at width 64 their channels are those of Chen et al., 32, 64 and 64."""
    layers: list[ImageLayer] = []
    inputs, size = CHANNELS, IMAGE_SIDE
    for number, (outputs, side, stride) in enumerate(
        ((config.width // 2, 8, 4), (config.width, 4, 2), (config.width, 3, 1))
    ):
        size = (size - side) // stride + 1
        layers.append(ImageLayer(f"layers.{number}", inputs, outputs, side, stride, size))
        inputs = outputs
    return layers
