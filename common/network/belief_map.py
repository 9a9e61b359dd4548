"""A small U-Net over the belief: what walls, unknown space and openings look like around each viewpoint.

A graph tells where a robot can go, not why it cannot go elsewhere. The values of the raster's cells are read at the
nodes and added to their embeddings; a node that no image shows gets nothing.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.belief_layers import belief_layers
from common.network.convolution import Convolution
from common.network.graph_batch import GraphBatch
from common.observations.belief_raster import RASTER_CHANNELS, RASTER_SIDE


class BeliefMap(nn.Module):
    """U-Net and a linear map that starts at zero, so that a network begins as if it were not there."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        layers = belief_layers(config)
        self.down_0 = Convolution(layers.down_0)
        self.down_1 = Convolution(layers.down_1)
        self.down_2 = Convolution(layers.down_2)
        self.bottom = Convolution(layers.bottom)
        self.up_1 = Convolution(layers.up_1)
        self.up_0 = Convolution(layers.up_0)
        self.out = nn.Linear(layers.up_0.outputs, config.width, bias=False)
        nn.init.zeros_(self.out.weight)

    def forward(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Return what is added to the embeddings, (nodes, d), and the values of all cells, (cells, channels)."""
        raster = batch.raster.view(-1, RASTER_CHANNELS, RASTER_SIDE, RASTER_SIDE)
        fine = self.down_0(raster)
        half = self.down_1(fine)
        found = self.bottom(self.down_2(half))
        found = self.up_1(torch.cat([_doubled(found), half], dim=1))
        found = self.up_0(torch.cat([_doubled(found), fine], dim=1))
        values = found.permute(0, 2, 3, 1).flatten(0, 2)
        shown = functional.pad(values, (0, 0, 0, 1)).index_select(0, batch.cells)
        return self.out(shown), values


def _doubled(images: Tensor) -> Tensor:
    """Return images of twice the size, each value four times."""
    return images.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
