"""The network of Chen et al.: convolutions over images of the map, and a value for each place around the robot.

Variant and preset `cnn`: F. Chen, S. Bai, T. Shan, B. Englot, "Self-Learning Exploration and Mapping for Mobile
Robots via Deep Reinforcement Learning", AIAA SciTech 2019. As published: the occupancy map around the robot, 1.5
ranges of the sensor to each side, is an image; three convolutions (8 x 8 by 4, 4 x 4 by 2, 3 x 3 by 1, with 32, 64
and 64 channels at width 64) and a hidden layer (512 with `feedforward` 8) give one number for each of a fixed set of
places around the robot, the goal of the next step; a step is rewarded for the floor that it shows.

What differs, because graph, learner and protocol are those of this project:

- The places are the 5 x 5 lattice steps around the robot instead of 50 sampled points around it, since a robot here
  drives along edges of the viewpoint graph. A waypoint beside these places gets a value interpolated between them,
  and only waypoints can be chosen: there are no collisions to punish, and no actions to mask after one.
- The values are the logits of a policy of soft actor-critic (10 tanh of a tenth of them, which bounds how sure it can
  be), with a critic of the same form, instead of the Q values of a DQN that explores by dropout. Dropout is left out,
  and so is the recurrent variant.
- The image has 48 pixels to a side instead of 84, and the robot is in its middle instead of drawn into it: the
  published window stops at the borders of the map.
- A second image of everything within 8 ranges was added, so that the policy can find its way out of places with
  nothing new. The publication drives to the nearest frontier then ("frontier rescue"), in training too, and ends the
  episode there; here this is the rule of `hdplanner` against cycles, which holds at evaluation alone.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from common.config import NetworkConfig
from common.network.convolution import Convolution
from common.network.graph_batch import GraphBatch
from common.network.image_layers import TABLE_SIDE, image_layers
from common.network.logits import LOGIT_LIMIT
from common.network.policy_network import PolicyNetwork, PolicyOutput
from common.network.segment import segment_log_softmax
from common.observations.feature_sets import DISTANCE_SCALE
from common.observations.observation import IMAGE_SIDE, IMAGES


class ImageTower(nn.Module):
    """The convolutions over one image."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Convolution(layer) for layer in image_layers(config))

    def forward(self, images: Tensor) -> Tensor:
        """Map shares (k, 2, side, side) to features (k, values)."""
        for layer in self.layers:
            images = layer(images)
        return images.flatten(1)


class ImageEncoder(nn.Module):
    """A tower for each image of an observation."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        for name in IMAGES:
            self.add_module(name, ImageTower(config))

    def forward(self, batch: GraphBatch) -> Tensor:
        """Encode the images of a batch: shape (k, 2 * values)."""
        assert batch.image is not None, "the arrays were made for this network"
        shares = torch.stack([batch.image >> 4, batch.image & 15], dim=2).float() / 15.0
        shares = shares.view(len(batch), len(IMAGES), 2, IMAGE_SIDE, IMAGE_SIDE)
        towers = [self.get_submodule(name) for name in IMAGES]
        return torch.cat([tower(shares[:, place]) for place, tower in enumerate(towers)], dim=1)


class PlaceTable(nn.Module):
    """One value for each place around the robot, read at the waypoints."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        hidden = config.feedforward * config.width
        self.join = nn.Linear(len(IMAGES) * image_layers(config)[-1].values, hidden)
        self.values = nn.Linear(hidden, TABLE_SIDE**2)

    def forward(self, encoded: Tensor, batch: GraphBatch) -> Tensor:
        """Return the value of every waypoint slot, float32, shape (total waypoints,): linear between the places."""
        table = self.values(functional.relu(self.join(encoded))).float().view(-1, TABLE_SIDE, TABLE_SIDE)
        steps = batch.features.index_select(0, batch.waypoint_rows)[:, :2] * DISTANCE_SCALE
        middle = TABLE_SIDE // 2
        places = torch.arange(-middle, middle + 1, device=steps.device)
        # A tent over each place: 1 there, 0 from the next one on; shape (total waypoints, 2, side).
        tents = (1.0 - (steps.clamp(-middle, middle).unsqueeze(2) - places).abs()).clamp(min=0.0)
        rows = torch.einsum("wr,wrc->wc", tents[:, 1], table.index_select(0, batch.waypoint_graph))
        return (rows * tents[:, 0]).sum(1)


class ImageNetwork(PolicyNetwork):
    """Encoder of images, and table of places; see the text of the module. An observation's waypoints are its pairs."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.encoder = ImageEncoder(config)
        self.table = PlaceTable(config)

    def forward(self, batch: GraphBatch) -> PolicyOutput:
        """Compute all log-probabilities of a batch."""
        logits = LOGIT_LIMIT * torch.tanh(self.table(self.encoder(batch), batch) / LOGIT_LIMIT)
        log_waypoint = segment_log_softmax(logits, batch.waypoint_graph, len(batch))
        return PolicyOutput(torch.zeros_like(batch.beacon_rows, dtype=torch.float32), log_waypoint, None, None)
