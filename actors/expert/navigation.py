"""The navigation expert: shortest paths to the target on the true map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.expert.base import UNREACHABLE, Judgement, leg_lengths
from actors.expert.lattice import TrueLattice, line_free
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config.schema import MappingConfig
from common.errors import HDError, MapError
from common.geometry import Pose
from common.observation import MAX_TARGET_LINKS, Observation

# The target joins the graph by line of sight as far as the longest lattice edge reaches.
LINK_REACH = float(np.sqrt(5.0))


class NavigationExpert:
    """Knows the graph distance from every true viewpoint to the target.

    The target joins the true graph like any viewpoint does: by line of sight to the viewpoints within the reach of a
    lattice edge; where there is none so near, to the nearest ones in sight at any distance.
    """

    def __init__(self, mapping: MappingConfig) -> None:
        self._mapping = mapping
        self._world: GridMap | None = None

    def reset(self, world: GridMap) -> None:
        """Prepare for a world; raise MapError for one without a target."""
        if world.target is None:
            raise MapError(f"map {world.name!r} has no target, so there is no way to it: use a navigation map")
        self._world = world
        self._lattice = TrueLattice.build(world, self._mapping.viewpoint_spacing)
        links, lengths = self._links(world, world.target)
        self._to_target = self._lattice.distances_from(links, lengths).astype(np.float64)

    def judge(
        self,
        observation: Observation,
        pose: Pose,
        node_position: tuple[float, float],
        coverage: Coverage,
    ) -> Judgement:
        """Judge the choices of one observation (see `Expert.judge`); what was seen does not matter."""
        del coverage
        if self._world is None or self._world.target is None:
            raise HDError("the expert knows no map yet: call reset(world) before judge()")
        true_nodes = self._lattice.match(observation, node_position)
        to_target = np.where(true_nodes >= 0, self._to_target[np.maximum(true_nodes, 0)], np.inf)
        if observation.has_target:
            to_target = np.append(to_target, 0.0)
        waypoints = observation.waypoint_nodes()
        total = leg_lengths(observation, waypoints, pose, node_position, self._lattice.spacing)
        total = total + to_target[waypoints]
        remaining = float(total.min())
        if not np.isfinite(remaining):
            return Judgement(np.zeros(len(waypoints), dtype=np.float32), -1, UNREACHABLE)
        cost = np.minimum(total - remaining, UNREACHABLE).astype(np.float32)
        return Judgement(cost, self._first_beacon(observation, true_nodes, to_target), remaining)

    def _links(self, world: GridMap, target: tuple[float, float]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the true viewpoints that see the target, nearest first, and their distances in metres."""
        x = (target[0] - world.origin[0]) / world.resolution
        y = (target[1] - world.origin[1]) / world.resolution
        points = self._lattice.points
        distance = np.hypot(points[:, 0] - x, points[:, 1] - y) * world.resolution
        free = np.ascontiguousarray(world.free)
        links: list[int] = []
        for v in np.argsort(distance, kind="stable"):
            far = distance[v] > LINK_REACH * self._lattice.spacing + 1e-6
            if len(links) == MAX_TARGET_LINKS or (far and links):
                break
            if line_free(free, points[v, 0], points[v, 1], x, y):
                links.append(int(v))
        chosen = np.array(links, dtype=np.int64)
        return chosen, distance[chosen]

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
        source = np.array([robot], dtype=np.int64)
        to_beacon = self._lattice.distances_from(source, np.zeros(1))[true_nodes[known]].astype(np.float64)
        detour = np.round(to_beacon + to_target[known], 3)
        if not np.isfinite(detour.min()):
            return -1
        return int(known[np.lexsort((to_beacon, detour))[0]])
