"""The contract of a privileged expert: what every choice would cost on the true map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.observation import Observation

# Cost of a choice from which the goal cannot be reached on the true map, metres; finite, so that it can be sent.
UNREACHABLE = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """An expert's view of one decision.

    Attributes:
        cost: detour of each waypoint in metres, in the order of `Observation.waypoint_nodes`; the best costs 0;
            float32.
        beacon: node number of the first beacon that the expert's route reaches, -1 when there is none.
        remaining: T(s), metres that the best route still takes from here.
    """

    cost: NDArray[np.float32]
    beacon: int
    remaining: float


class Expert(Protocol):
    """Sees the true map, and judges what the robot may choose.

    Usage::

        expert.reset(world)
        judgement = expert.judge(observation, pose, node_position, coverage)
        waypoint = observation.waypoint_nodes()[judgement.cost.argmin()]
    """

    def reset(self, world: GridMap) -> None:
        """Prepare for a world: true viewpoint graph, visibility, distances."""
        ...

    def judge(
        self,
        observation: Observation,
        pose: Pose,
        node_position: tuple[float, float],
        coverage: Coverage,
    ) -> Judgement:
        """Judge the choices of one observation.

        Args:
            observation: what the policy sees; at least one waypoint.
            pose: where the robot stands.
            node_position: position of the robot's viewpoint, metres.
            coverage: what has been seen of the true map.
        """
        ...


def leg_lengths(
    observation: Observation,
    waypoints: NDArray[np.int64],
    pose: Pose,
    node_position: tuple[float, float],
    spacing: float,
) -> NDArray[np.float64]:
    """Metres from where the robot stands to each waypoint, by way of its viewpoint when it stands beside it.

    A target counts with its own offset. Returns float64, shape of ``waypoints``.
    """
    steps = observation.offsets.astype(np.float64)
    if observation.has_target:
        steps = np.concatenate([steps, observation.target_offset[None].astype(np.float64)])
    steps = steps[waypoints]
    return pose.distance_to(node_position) + spacing * np.hypot(steps[:, 0], steps[:, 1])
