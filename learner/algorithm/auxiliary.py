"""What the network learns to foresee beside its choices: free space beyond frontiers, and what viewpoints would show.

Both are told by the simulator's true map. The heads serve training alone: neither actors nor robots have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.messages.experience import ExpertLabels
from common.network.belief_layers import belief_layers
from common.network.graph_arrays import GraphArrays
from common.network.policy_network import PolicyOutput
from common.observations.belief_raster import RASTER_SIDE, SUBCELLS
from common.observations.observation import IMAGE_SIDE, ObservationBatch
from learner.algorithm.whole import mean

# A pixel is asked for when most of it is unknown, and known free space is at most this many pixels away.
_UNKNOWN = 8
_BEYOND = 4


@dataclass(frozen=True, slots=True, eq=False)
class Hints:
    """What the heads are taught, on the device.

    Attributes:
        free: which share of each subcell's unknown part is free, float32, shape (cells, `SUBCELLS`).
        asked: subcells that count, bool, of the same shape.
        gain: what the viewpoint at each node would show, as a share of the sensor's disc, -1 where unknown, float32,
            shape (nodes,).
    """

    free: Tensor
    asked: Tensor
    gain: Tensor

    @classmethod
    def of(
        cls,
        observations: ObservationBatch,
        labels: ExpertLabels,
        labelled: NDArray[np.bool_],
        arrays: GraphArrays,
        device: torch.device,
    ) -> Hints | None:
        """Lay out the hints of k observations; None when there are none.

        Args:
            observations: with images.
            labels: of all of them.
            labelled: which of the labels mean anything, shape (k,).
            arrays: of the same observations.
            device: where to.
        """
        if labels.gain is None or labels.truth is None or observations.image is None:
            return None
        shape = (-1, IMAGE_SIDE, IMAGE_SIDE)
        known_free, occupied = (observations.image >> 4).reshape(shape), (observations.image & 15).reshape(shape)
        truly_free = (labels.truth >> 4).reshape(shape).astype(np.int64)
        unknown = 15 - known_free.astype(np.int64) - occupied
        free = np.clip((truly_free - known_free) / np.maximum(unknown, 1), 0.0, 1.0).astype(np.float32)
        seen = torch.from_numpy((known_free > 0).astype(np.float32))[:, None]
        near = functional.max_pool2d(seen, 2 * _BEYOND + 1, 1, _BEYOND)[:, 0].numpy() > 0.0
        asked = (unknown >= _UNKNOWN) & near & np.repeat(labelled, len(unknown) // len(labelled))[:, None, None]
        # What is padding of the raster is asked for nowhere.
        return cls(
            free=torch.from_numpy(_in_cells(free)).to(device),
            asked=torch.from_numpy(_in_cells(asked)).to(device),
            gain=torch.from_numpy(_at_nodes(labels.gain, observations.count, arrays)).to(device),
        )


class AuxiliaryHeads(nn.Module):
    """A linear map from the belief's cells to what is free there, and one from the nodes to the root of their gain."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.free = nn.Linear(belief_layers(config).up_0.outputs, SUBCELLS)
        self.gain = nn.Linear(config.width, 1)

    def forward(self, output: PolicyOutput, hints: Hints) -> tuple[Tensor, Tensor]:
        """Return both losses, scalars: cross entropy of free subcells [nats], and Huber loss of the gains' roots."""
        assert output.cells is not None and output.nodes is not None, "the configuration was checked"
        logits = self.free(output.cells).float()
        free = functional.binary_cross_entropy_with_logits(logits, hints.free, reduction="none")
        found = self.gain(output.nodes).squeeze(1).float()
        gain = functional.smooth_l1_loss(found, hints.gain.clamp(min=0.0).sqrt(), reduction="none", beta=0.1)
        return mean(free, hints.asked), mean(gain, hints.gain >= 0.0)


def _in_cells(pixels: NDArray[np.generic]) -> NDArray[np.generic]:
    """Lay pixels, shape (images, side, side), out as the raster's cells, shape (cells, `SUBCELLS`)."""
    blocks = pixels[:, 1:-1, 1:-1].reshape(len(pixels), RASTER_SIDE - 1, 2, RASTER_SIDE - 1, 2)
    blocks = blocks.transpose(0, 1, 3, 2, 4).reshape(len(pixels), RASTER_SIDE - 1, RASTER_SIDE - 1, SUBCELLS)
    padded: NDArray[np.generic] = np.pad(blocks, ((0, 0), (0, 1), (0, 1), (0, 0)))
    return padded.reshape(-1, SUBCELLS)


def _at_nodes(gain: NDArray[np.float32], count: NDArray[np.int32], arrays: GraphArrays) -> NDArray[np.float32]:
    """Return the gain of the viewpoint at each node, -1 for targets."""
    owner = np.repeat(np.arange(len(count)), np.diff(arrays.node_ptr))
    first = np.cumsum(count, dtype=np.int64) - count
    viewpoint = arrays.nodes < count[owner]
    found = np.full(len(owner), -1.0, dtype=np.float32)
    found[viewpoint] = gain[(first[owner] + arrays.nodes)[viewpoint]]
    return found
