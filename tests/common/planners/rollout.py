"""Episodes of a planner in the grid simulator, in the nominal protocol, for tests and experiments."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from actors.tasks.coverage import Coverage
from common.config.schema import MappingConfig, SimulatorConfig, TaskConfig
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Status

LIMIT = 5.0**0.5


@dataclass
class Episode:
    """What came of it."""

    status: Status
    reason: str
    complete: bool
    distance: float
    waypoints: list[tuple[float, float]]
    explored: float
    plans: list[Plan] = field(default_factory=list)
    decision_ms: list[float] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return len(self.waypoints) - 1


def explore(
    planner: Planner,
    world: GridMap,
    config: MappingConfig,
    *,
    seed: int = 0,
    max_steps: int = 128,
    unseen_area: float | None = None,
    rays: int = 720,
) -> Episode:
    """Drive until the world is seen, the planner ends or the steps are used up; every waypoint is checked."""
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=rays), config.sensor_range)
    pose = simulator.reset(world, seed)
    bounds = (*world.origin, world.origin[0] + world.size[0], world.origin[1] + world.size[1])
    mapper = Mapper(config, lattice_origin=world.lattice_origin, bounds=bounds)
    coverage = Coverage(world)
    enough = TaskConfig().unseen_area if unseen_area is None else unseen_area
    planner.reset("exploration", None, seed)
    episode = Episode(Status.GOING, "step limit", False, 0.0, [pose.position], 0.0)
    for step in range(max_steps + 1):
        scan = simulator.scan()
        started = time.thread_time()
        mapper.integrate(scan, pose)
        mapper.update(pose)
        updated = time.thread_time()
        coverage.update(mapper.belief.cells, mapper.belief.resolution, mapper.belief.origin)
        episode.explored = coverage.explored
        if coverage.unseen_area <= enough:
            episode.complete, episode.reason = True, "complete"
            break
        if step == max_steps:
            break
        resumed = time.thread_time()
        plan = planner.plan(mapper, pose)
        episode.decision_ms.append((updated - started + time.thread_time() - resumed) * 1e3)
        episode.plans.append(plan)
        episode.status = plan.status
        if plan.status is not Status.GOING:
            episode.reason = plan.reason
            break
        assert plan.waypoint is not None
        length = pose.distance_to(plan.waypoint)
        assert 0.0 < length <= LIMIT * config.viewpoint_spacing + 1e-6, (pose, plan.waypoint)
        assert mapper.segment_free(pose.position, plan.waypoint), (pose, plan.waypoint)
        leg = simulator.drive_to(plan.waypoint)
        assert leg.reached
        pose = leg.pose
        episode.distance += leg.distance
        episode.waypoints.append(pose.position)
    simulator.close()
    return episode


def drawn(rows: list[str], resolution: float = 0.5, block: int = 8) -> GridMap:
    """Return a world drawn in characters of 4 m: `#` wall, `.` free, `S` start; the top row first."""
    grid = np.array([list(row) for row in rows])[::-1]
    free: NDArray[np.bool_] = np.kron(grid != "#", np.ones((block, block), dtype=np.bool_)).astype(np.bool_)
    row, column = (int(k[0]) for k in np.nonzero(grid == "S"))
    side = block * resolution
    start = ((column + 0.5) * side, (row + 0.5) * side)
    return GridMap("drawn", free, resolution, (0.0, 0.0), start, None, None, (side / 2, side / 2))
