"""The networks of ARiADNE and of context-aware navigation: an encoder over the graph, and a pointer at a neighbour.

**ARiADNE** (variant and preset `ariadne`): Y. Cao, T. Hou, Y. Wang, X. Yi, G. Sartoretti, "ARiADNE: A Reinforcement
Learning Approach Using Attention-Based Deep Networks for Exploration", ICRA 2023. As published: six layers of
attention masked to the graph's edges, width 128, 8 heads; a decoder in which the robot's node asks all nodes; a
pointer (10 tanh) over its neighbours; soft actor-critic with discrete actions; the features position, utility and
guidepost (has the robot been there?); the reward of removed frontiers, travelled distance and a bonus of 20 for
finishing.

**Context-aware navigation** (variant and preset `ca`): J. Liang, Z. Wang, Y. Cao, J. Chiun, M. Zhang, G. Sartoretti,
"Context-Aware Deep Reinforcement Learning for Autonomous Robotic Navigation in Unknown Area", CoRL 2023. The same
network; each node also has the direction and the distance to the target; the reward is how much shorter the way to
the target on the true map becomes, less a cost for each step, and a bonus of 20 for arriving.

What differs from both, because graph, learner and protocol are those of this project:

- The graph is the one of docs/graph.md: viewpoints 4 m apart on a lattice that may have several pieces in a square,
  edges that may be bent, instead of 30 x 30 points of the image. The released code of `ca` puts the target into the
  graph and joins it to its nearest points when it is seen; here it is tied to beacons until then.
- Positions and distances are relative to the robot and in lattice steps, utilities are log(1 + frontiers) / 4 instead
  of frontiers / 50, and the target's distance is divided by 20 steps instead of by the range of the sensor.
- Encoder and decoder end in a layer norm.
- An exploration ends when at most 15.6 m² are unseen, not when no node has a utility; a navigation within 1.6 m.
- Discount, learning rate, temperature and the copies of the critics are those of the preset, not 1 and 1e-5; the
  bonus of 20 is then worth less than in an undiscounted sum.
- Not there: the refinements of later versions of ARiADNE (graph rarefaction, the privileged critic).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from common.config import NetworkConfig
from common.network.decoders import DecoderLayer, Pointer
from common.network.encoder import Encoder
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyNetwork, PolicyOutput
from common.network.segment import segment_log_softmax


class PointerDecoder(nn.Module):
    """The robot's feature asks all viewpoints, is joined with what it learns, and points at a waypoint."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.join = nn.Linear(2 * config.width, config.width)
        self.decoder = DecoderLayer(config)
        self.pointer = Pointer(config.width)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Return log π_a, shape (total waypoints,)."""
        asked = ask_robots(self.decoder, nodes, batch)
        queries = self.pointer.query(self.join(asked)).index_select(0, batch.waypoint_graph)
        keys = self.pointer.key(nodes.index_select(0, batch.waypoint_rows))
        return segment_log_softmax(self.pointer(queries, keys), batch.waypoint_graph, len(batch))


class PointerNetwork(PolicyNetwork):
    """Encoder and pointer; see the text of the module. The waypoints of an observation are its pairs."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.encoder = Encoder(config)
        self.waypoint_decoder = PointerDecoder(config)

    def forward(self, batch: GraphBatch) -> PolicyOutput:
        """Compute all log-probabilities of a batch."""
        log_waypoint = self.waypoint_decoder(self.encoder(batch), batch)
        return PolicyOutput(torch.zeros_like(batch.beacon_rows, dtype=torch.float32), log_waypoint, None, None)


def ask_robots(decoder: DecoderLayer, nodes: Tensor, batch: GraphBatch) -> Tensor:
    """Let the robot of each observation ask its nodes; return the answers beside the robots' features, (k, 2 d)."""
    robots = nodes.index_select(0, batch.robot_rows)
    answers: Tensor = decoder(robots, np.arange(len(batch) + 1), decoder.keys_values(nodes), batch)
    return torch.cat([answers, robots], dim=1)
