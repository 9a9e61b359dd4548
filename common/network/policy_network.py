"""What every policy network owes the losses: log-probabilities of beacons and waypoints."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from torch import Tensor, nn

from common.config import NetworkConfig
from common.network.graph_batch import GraphBatch


@dataclass(frozen=True, slots=True, eq=False)
class PolicyOutput:
    """What the policy network says about a batch; slots and pairs are those of the `GraphBatch`.

    Attributes:
        log_beacon: log π_b(b | o), float32, shape (total beacons,); zeros where no beacon is chosen.
        log_waypoint: log π_a(a | o, b) of every pair, float32, shape (total pairs,).
        beacon_features: decoded feature of each beacon, shape (total beacons, d); None where no beacon is chosen.
        waypoint_features: decoded feature of each waypoint, shape (total waypoints, d), for the contrastive loss; None
            in networks that it is not for.
        nodes: encoded feature of each node, shape (nodes, d), for auxiliary losses; None likewise.
        cells: values of the belief's cells, shape (cells, channels); None where no belief is read.
    """

    log_beacon: Tensor
    log_waypoint: Tensor
    beacon_features: Tensor | None
    waypoint_features: Tensor | None
    nodes: Tensor | None = None
    cells: Tensor | None = None


class PolicyNetwork(nn.Module, ABC):
    """A network that chooses: `common.network.factory.make_policy_network` makes that of a configuration.

    Its weights are those of `common.network.parameters.parameter_shapes`; `common.network.inference` does the same in
    numpy for one observation at a time, and `learner.run.onnx_model` in ONNX.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config

    @abstractmethod
    def forward(self, batch: GraphBatch) -> PolicyOutput:
        """Compute all log-probabilities of a batch."""
