"""Episodes of a planner in the grid simulator, in the nominal protocol, for tests and experiments."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from actors.tasks.coverage import Coverage
from common.config import MappingConfig, SimulatorConfig, TaskConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Status

LIMIT = 5.0**0.5
BLOCK = 8
RESOLUTION = 0.5


@dataclass
class Episode:
    """What came of it.

    `status` and `reason` are the planner's last words; `complete` is what the task says of them.
    """

    waypoints: list[tuple[float, float]]
    status: Status = Status.GOING
    reason: str = "step limit"
    complete: bool = False
    distance: float = 0.0
    explored: float = 0.0
    plans: list[Plan] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return len(self.waypoints) - 1


def explore(
    planner: Planner, world: GridMap, config: MappingConfig, *, unseen_area: float | None = None, **options: Any
) -> Episode:
    """Drive until all but some square metres of a world are seen; see `drive`."""
    task = TaskConfig(name="exploration")
    if unseen_area is not None:
        # Less than nothing is never enough: the planner itself has to end the episode.
        task = task.model_copy(update={"unseen_area": unseen_area})
    return drive(planner, world, config, task, **options)


def navigate(planner: Planner, world: GridMap, config: MappingConfig, **options: Any) -> Episode:
    """Drive to the target of a world; see `drive`."""
    return drive(planner, world, config, TaskConfig(name="navigation"), **options)


def drive(
    planner: Planner,
    world: GridMap,
    config: MappingConfig,
    task: TaskConfig,
    *,
    seed: int = 0,
    max_steps: int = 128,
    rays: int = 720,
    bounded: bool = True,
    slack: float = 0.0,
) -> Episode:
    """Drive until the task is complete, the planner ends or the steps are used up; every waypoint is checked.

    Unless it is `bounded`, the belief starts as a grid without cells and grows. The robot stops `slack` metres before
    its waypoints, and does not move for less, as real ones do.
    """
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=rays), config.sensor_range)
    pose = simulator.reset(world, seed)
    bounds = (*world.origin, world.origin[0] + world.size[0], world.origin[1] + world.size[1])
    judge, coverage = make_goal(task), Coverage(world, config.robot_radius)
    judge.reset(world)
    mapper = Mapper(
        config, lattice_origin=world.lattice_origin, bounds=bounds if bounded else None, target=judge.target
    )
    planner.reset(task.name, judge.target, seed)
    episode = Episode([pose.position])
    for step in range(max_steps + 1):
        mapper.integrate(simulator.scan(), pose)
        mapper.update(pose)
        coverage.update(mapper.belief.cells, mapper.belief.resolution, mapper.belief.origin)
        episode.explored = coverage.explored
        if judge.complete(coverage, pose):
            episode.complete, episode.reason = True, "complete"
            break
        if step == max_steps:
            break
        plan = planner.plan(mapper, pose)
        episode.plans.append(plan)
        episode.status = plan.status
        if plan.status is not Status.GOING:
            assert plan.waypoint is None
            episode.reason = plan.reason
            break
        assert plan.waypoint is not None
        way = [*plan.via, plan.waypoint]
        for here, there in pairwise([pose.position, *way]):
            length = Pose(*here).distance_to(there)
            assert 0.0 < length <= LIMIT * config.viewpoint_spacing + 1e-6, (here, there)
            assert mapper.segment_free(here, there), (here, there)
        for there in way:
            # It looks around at the corners of a way, too.
            if there != way[0]:
                mapper.integrate(simulator.scan(), pose)
                mapper.update(pose)
            stop = slack if there == plan.waypoint else 0.0
            share = max(1.0 - stop / pose.distance_to(there), 0.0)
            place = (pose.x + share * (there[0] - pose.x), pose.y + share * (there[1] - pose.y))
            leg = simulator.drive_to(place if stop else there)
            assert leg.reached
            pose = leg.pose
            episode.distance += leg.distance
        episode.waypoints.append(pose.position)
    simulator.close()
    return episode


def drawn(rows: list[str]) -> GridMap:
    """Return a world drawn in characters of 4 m, the top row first.

    `#` wall, `.` free, `S` start; `T` a target, `t` one inside a wall.
    """
    letters = np.array([list(row) for row in rows])[::-1]
    solid = np.isin(letters, ["#", "t"])
    free: NDArray[np.bool_] = np.kron(~solid, np.ones((BLOCK, BLOCK), dtype=np.bool_)).astype(np.bool_)
    side = BLOCK * RESOLUTION
    start, *_ = _centres(letters == "S", side)
    world = GridMap("drawn", free, RESOLUTION, (0.0, 0.0), start, None, None, (side / 2, side / 2))
    targets = _centres(np.isin(letters, ["T", "t"]), side)
    return dataclasses.replace(world, target=targets[0]) if targets else world


def _centres(mask: NDArray[np.bool_], side: float) -> list[tuple[float, float]]:
    return [((column + 0.5) * side, (row + 0.5) * side) for row, column in np.argwhere(mask).tolist()]
