"""The shape of the U-Net over the belief, shared by its three implementations (torch, numpy, ONNX)."""

from __future__ import annotations

from typing import NamedTuple

from common.config import NetworkConfig
from common.network.image_layers import ImageLayer
from common.observations.belief_raster import RASTER_CHANNELS, RASTER_SIDE


class BeliefLayers(NamedTuple):
    """Convolutions of 3 x 3 with padding and a ReLU: three on the way down, one at the bottom, two on the way up.

    On the way up the result of the layer before is doubled in size, each value four times, and stands before that of
    the layer of the same size on the way down.
    """

    down_0: ImageLayer
    down_1: ImageLayer
    down_2: ImageLayer
    bottom: ImageLayer
    up_1: ImageLayer
    up_0: ImageLayer


def belief_layers(config: NetworkConfig) -> BeliefLayers:
    """Return the layers; at width 64 their channels are 16, 24 and 32."""
    fine, half, quarter = config.width // 4, 3 * config.width // 8, config.width // 2

    def layer(name: str, inputs: int, outputs: int, scale: int, stride: int = 1) -> ImageLayer:
        return ImageLayer(name, inputs, outputs, 3, stride, RASTER_SIDE // scale, padding=1)

    return BeliefLayers(
        layer("down_0", RASTER_CHANNELS, fine, 1),
        layer("down_1", fine, half, 2, stride=2),
        layer("down_2", half, quarter, 4, stride=2),
        layer("bottom", quarter, quarter, 4),
        layer("up_1", quarter + half, half, 2),
        layer("up_0", half + fine, fine, 1),
    )
