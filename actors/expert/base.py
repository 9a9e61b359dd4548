"""The interface of a privileged expert: what every choice would cost on the true map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.geometry import Pose
from common.observations.observation import Observation

# Cost of a choice from which the goal cannot be reached on the true map, metres; finite, so that it can be sent.
UNREACHABLE = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class ExpertLabel:
    """An expert's view of one decision.

    Attributes:
        cost: detour of each waypoint in metres, in the order of `Observation.waypoint_nodes`; the best costs 0;
            float32.
        beacon: node number of the first beacon that the expert's route reaches, -1 when there is none.
        remaining: T(s), metres that the best route still takes from here.
        unseen: reachable area that is not seen yet, square metres; 0 in navigation, where it does not count.
        gain: see `ExpertLabels`, float32, shape (viewpoints,); None where nobody asks.
        truth: likewise, uint8, shape (2, pixels).
    """

    cost: NDArray[np.float32]
    beacon: int
    remaining: float
    unseen: float = 0.0
    gain: NDArray[np.float32] | None = None
    truth: NDArray[np.uint8] | None = None


class Expert(Protocol):
    """Sees the true map, and judges what the robot may choose.

    Usage::

        expert.reset(world)
        expert_label = expert.label(observation, mapper.viewpoints, pose, coverage)
        waypoint = observation.waypoint_nodes()[expert_label.cost.argmin()]
    """

    def reset(self, world: GridMap) -> None:
        """Prepare for a world: true viewpoint graph, visibility, distances.

        Raises:
            MapError: the world does not suit the task, or the robot does not fit at its start.
        """
        ...

    def label(
        self,
        observation: Observation,
        positions: NDArray[np.float64],
        pose: Pose,
        coverage: Coverage,
    ) -> ExpertLabel:
        """Judge the choices of one observation.

        A viewpoint counts as the true one whose piece of clear space holds its place. While a lattice square is only
        partly known, several viewpoints may be pieces of what is truly one.

        Args:
            observation: what the policy sees; at least one waypoint.
            positions: of its viewpoints, metres, shape (n, 2).
            pose: where the robot stands.
            coverage: what has been seen of the true map.
        """
        ...


def leg_lengths(
    observation: Observation,
    positions: NDArray[np.float64],
    places: NDArray[np.float64],
    pose: Pose,
    spacing: float,
) -> NDArray[np.float64]:
    """Metres from where the robot stands to each waypoint, by way of its viewpoint when it stands beside it.

    Edges that are not straight count with the length of their way, a target with its own offset. A viewpoint that does
    not lie where the true one does counts as at least as far away as that: the rest of the way begins there.

    Args:
        observation: what the policy sees.
        positions: of its viewpoints, metres, shape (n, 2).
        places: of the true ones that they stand for, likewise.
        pose: where the robot stands.
        spacing: metres to a lattice step.

    Returns:
        In the order of `Observation.waypoint_nodes`, float64.
    """
    robot = observation.robot
    home = positions[robot]
    nodes = observation.waypoint_nodes()
    viewpoints = nodes[nodes < observation.viewpoints]
    lengths: NDArray[np.float64] = np.hypot(*(positions[viewpoints] - home).T)
    # The robot's edges in the order of its neighbours: those that lower ones list, then its own.
    end = int(observation.degree[: robot + 1].sum(dtype=np.int64))
    listed = np.arange(end - int(observation.degree[robot]), end)
    edges = np.concatenate([np.flatnonzero(observation.neighbours == robot), listed])
    bent = np.flatnonzero(np.isin(edges, observation.bent))
    ways = observation.bent_length[np.searchsorted(observation.bent, edges[bent])]
    lengths[bent] = spacing * ways.astype(np.float64)
    lengths = np.maximum(lengths, np.hypot(*(places[viewpoints] - home).T))
    if len(viewpoints) < len(nodes):
        lengths = np.append(lengths, spacing * np.hypot(*observation.target_offset.astype(np.float64)))
    return pose.distance_to((float(home[0]), float(home[1]))) + lengths
