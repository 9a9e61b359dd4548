"""Walks through true maps with real scans: always to the nearest viewpoint where something is left to see."""

from __future__ import annotations

import numpy as np

from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.mapping.worlds import scan_of

BEAMS = 720


class Walk:
    """A robot on its way; it scans wherever a way has a corner.

    Attributes:
        mapper: updated where the robot stands.
        coverage: what of the reachable clear floor it has seen.
        travelled: metres.
    """

    def __init__(self, world: GridMap, config: MappingConfig) -> None:
        """Look around at the start."""
        width, height = world.size
        x, y = world.origin
        self.world, self.config = world, config
        self.mapper = Mapper(config, lattice_origin=world.lattice_origin, bounds=(x, y, x + width, y + height))
        self.coverage = Coverage(world, config.robot_radius)
        self.travelled = 0.0
        self.pose = Pose(*world.start)
        self._look()
        self.mapper.update(self.pose)

    def goals(self) -> np.ndarray:
        """Nodes that observe frontiers and where the robot has not been."""
        observation = self.mapper.observe()
        return np.flatnonzero((observation.utility > 0) & ~observation.visited)

    def step(self) -> bool:
        """Drive one edge towards the nearest goal, or onto the robot's viewpoint; return whether there is a goal."""
        mapper, goals = self.mapper, self.goals()
        if not len(goals):
            return False
        goal = int(goals[np.argmin(mapper.distances(mapper.robot)[goals])])
        home = mapper.position(mapper.robot)
        if self.pose.distance_to(home) > 1e-9:
            way = mapper.way_home()
        elif goal == mapper.robot:
            raise AssertionError(f"the robot stands at {home}, and is told to look from there")
        else:
            way = mapper.way(mapper.robot, mapper.path(mapper.robot, goal)[1])
        for place in way:
            assert mapper.segment_free(self.pose.position, place)
            self.travelled += self.pose.distance_to(place)
            self.pose = Pose(*place)
            self._look()
        mapper.update(self.pose)
        return True

    def measure(self) -> float:
        """Return how much of the reachable clear floor is unseen, square metres."""
        belief = self.mapper.belief
        self.coverage.update(belief.cells, belief.resolution, belief.origin)
        return self.coverage.unseen_area

    def _look(self) -> None:
        world, reach = self.world, self.config.sensor_range
        scan = scan_of(world.free, world.resolution, world.origin, self.pose, range_max=reach, beams=BEAMS)
        self.mapper.integrate(scan, self.pose)
