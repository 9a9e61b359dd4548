"""The navigation expert: shortest paths to the target on the true map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.expert.base import UNREACHABLE, ExpertLabel, leg_lengths
from actors.expert.true_graph import TrueGraph
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig, TaskConfig
from common.errors import HDError, MapError
from common.geometry import Pose
from common.observations.observation import Observation


class NavigationExpert:
    """Knows the graph distance from every true viewpoint to the target.

    The target joins the true graph as a known one joins the robot's: by straight edges, or by the way inside its piece.
    """

    def __init__(self, mapping: MappingConfig) -> None:
        self._mapping = mapping
        self._world: GridMap | None = None

    def reset(self, world: GridMap) -> None:
        """Prepare for a world; raise MapError for one without a target."""
        if world.target is None:
            raise MapError(f"map {world.name!r} has no target: use a navigation map")
        self._world = world
        self._graph = TrueGraph.build(world, self._mapping)
        self._to_target = self._graph.distances_to_target()

    def label(
        self,
        observation: Observation,
        positions: NDArray[np.float64],
        pose: Pose,
        coverage: Coverage,
    ) -> ExpertLabel:
        """Judge the choices of one observation (see `Expert.judge`); what was seen does not matter."""
        del coverage
        if self._world is None or self._world.target is None:
            raise HDError("the expert has no map yet: call reset(world) before judge()")
        true_nodes, places = self._graph.match(positions)
        to_target = np.where(true_nodes >= 0, self._to_target[true_nodes], np.inf)
        if observation.has_target:
            to_target = np.append(to_target, 0.0)
        waypoints = observation.waypoint_nodes()
        legs = leg_lengths(observation, positions, places, pose, self._mapping.viewpoint_spacing)
        total = legs + to_target[waypoints]
        remaining = float(total.min())
        if not np.isfinite(remaining):
            return ExpertLabel(np.zeros(len(waypoints), dtype=np.float32), -1, UNREACHABLE)
        cost = np.minimum(total - remaining, UNREACHABLE).astype(np.float32)
        return ExpertLabel(cost, self._first_beacon(observation, true_nodes, to_target), remaining)

    def _first_beacon(
        self, observation: Observation, true_nodes: NDArray[np.int64], to_target: NDArray[np.float64]
    ) -> int:
        """Return the beacon of the smallest detour on the way to the target, the nearer one first; -1 without."""
        beacons = observation.beacon_nodes()
        if observation.target_known:
            return observation.viewpoints
        robot = true_nodes[observation.robot]
        known = beacons[true_nodes[beacons] >= 0]
        if robot < 0 or len(known) == 0:
            return -1
        to_beacon = self._graph.distances_from(int(robot))[true_nodes[known]]
        detour = np.round(to_beacon + to_target[known], 3)
        if not np.isfinite(detour.min()):
            return -1
        return int(known[np.lexsort((to_beacon, detour))[0]])


def make_expert(task: TaskConfig, mapping: MappingConfig) -> NavigationExpert:
    """Return the expert that `common.tasks.NAVIGATION` names."""
    del task
    return NavigationExpert(mapping)
