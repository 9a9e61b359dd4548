"""A policy that acts: from one observation to a beacon and the next waypoint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.network.inference import DecisionNetwork, make_inference
from common.network.parameters import Arrays, check_parameters, initial_parameters, parameter_shapes
from common.observations.observation import Observation, ObservationBatch
from common.system.blas import one_blas_thread


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """One decision (b, a) and how sure the policy was.

    Attributes:
        beacon: chosen beacon, node number.
        waypoint: chosen waypoint, node number.
        log_probability: log π(b, a | o).
        beacon_probabilities: π_b, in the order of `Observation.beacon_nodes`; 1 at the reported one in networks that
            choose none.
        waypoint_probabilities: the marginal Σ_b π_b π_a(. | b), in the order of `Observation.waypoint_nodes`.
    """

    beacon: int
    waypoint: int
    log_probability: float
    beacon_probabilities: NDArray[np.float32]
    waypoint_probabilities: NDArray[np.float32]


class Policy:
    """The policy of one actor or robot.

    Usage::

        policy = Policy.from_config(config.network)
        policy.load(weights, version=12)
        decision = policy.decide(observation, greedy=False, rng=rng)

    Attributes:
        config: the network's configuration.
        version: number of the loaded weights; 0 for the random ones at the start.
    """

    def __init__(self, config: NetworkConfig, arrays: Arrays, version: int = 0) -> None:
        self.config = config
        self._shapes = parameter_shapes(config)
        self._network: DecisionNetwork
        self.load(arrays, version)

    @classmethod
    def from_config(cls, config: NetworkConfig, seed: int = 0) -> Self:
        """Make a policy with random weights."""
        return cls(config, initial_parameters(config, seed))

    @classmethod
    def with_network(cls, config: NetworkConfig, network: DecisionNetwork, version: int) -> Self:
        """Make a policy that another engine runs, such as `common.network.onnx_network`."""
        policy = cls.__new__(cls)
        policy.config = config
        policy._shapes = parameter_shapes(config)
        policy._network = network
        policy.version = version
        return policy

    def load(self, arrays: Arrays, version: int) -> None:
        """Take over new weights; nothing changes when they do not fit.

        Raises:
            WeightsError: a weight is missing, unknown, of another shape or type, or not finite.
        """
        check_parameters(arrays, self._shapes)
        self._network = make_inference(self.config, arrays)
        self.version = version

    def decide(
        self,
        observation: Observation,
        *,
        greedy: bool,
        rng: np.random.Generator,
    ) -> Decision:
        """Choose a beacon and a waypoint.

        Greedy takes the waypoint of the largest marginal Σ_b π_b π_a(a | b), which is steadier than that of the most
        probable beacon, and reports the beacon that contributes most to it. Otherwise (b, a) is drawn from π.

        A policy without beacons (`vanilla`, the baselines) reports the one nearest to the robot in a straight line.

        Args:
            observation: what the robot knows; it must have a beacon and a waypoint.
            greedy: take the best instead of drawing.
            rng: source of chance.

        Raises:
            ValueError: there is no beacon or no waypoint to choose.
        """
        graph = GraphArrays.from_observations(ObservationBatch.stack([observation]), self.config)
        waypoints = graph.nodes[graph.waypoint_rows]
        beacons = graph.nodes[graph.beacon_rows] if graph.has_beacons else observation.beacon_nodes()
        if len(waypoints) == 0 or len(beacons) == 0:
            raise ValueError(
                f"an observation needs a beacon and a waypoint to decide, got {len(beacons)} beacons and "
                f"{len(waypoints)} waypoints: the episode should have ended"
            )
        with one_blas_thread():
            log_beacon, log_waypoint = self._network(graph)
        log_joint = log_beacon[:, None] + log_waypoint
        joint = np.exp(log_joint)
        marginal = joint.sum(axis=0)
        if greedy:
            waypoint = int(marginal.argmax())
            slot = int(joint[:, waypoint].argmax())
        else:
            cumulative = np.cumsum(joint.ravel(), dtype=np.float64)
            drawn = int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right"))
            slot, waypoint = divmod(min(drawn, joint.size - 1), len(waypoints))
        beacon_probabilities = np.exp(log_beacon)
        log_probability = float(log_joint[slot, waypoint])
        if not graph.has_beacons:
            slot = _nearest(observation, beacons)
            beacon_probabilities = np.zeros(len(beacons), dtype=np.float32)
            beacon_probabilities[slot] = 1.0
        return Decision(
            beacon=int(beacons[slot]),
            waypoint=int(waypoints[waypoint]),
            log_probability=log_probability,
            beacon_probabilities=beacon_probabilities,
            waypoint_probabilities=marginal,
        )


def _nearest(observation: Observation, beacons: NDArray[np.int64]) -> int:
    """Return the place in ``beacons`` of the one nearest to the robot."""
    steps = observation.steps[beacons]
    return int(np.hypot(steps[:, 0], steps[:, 1]).argmin())
