"""A convolution of the networks over images."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from common.network.image_layers import ImageLayer


class Convolution(nn.Module):
    """A convolution whose weights are a matrix, as all weights on the bus have two dimensions at most; and a ReLU."""

    def __init__(self, layer: ImageLayer) -> None:
        super().__init__()
        inputs = layer.inputs * layer.side**2
        self.layer = layer
        self.weight = nn.Parameter(torch.empty(layer.outputs, inputs).uniform_(-(inputs**-0.5), inputs**-0.5))
        self.bias = nn.Parameter(torch.empty(layer.outputs).uniform_(-(inputs**-0.5), inputs**-0.5))

    def forward(self, images: Tensor) -> Tensor:
        """Map (k, inputs, side, side) to (k, outputs, result, result)."""
        layer = self.layer
        kernel = self.weight.view(layer.outputs, layer.inputs, layer.side, layer.side)
        return functional.relu(functional.conv2d(images, kernel, self.bias, layer.stride, layer.padding))
