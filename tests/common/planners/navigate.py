"""Navigation episodes of a planner in the grid simulator, in the nominal protocol, for tests and experiments."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from actors.tasks.coverage import Coverage
from actors.tasks.navigation import NavigationTask
from common.config.schema import MappingConfig, SimulatorConfig, TaskConfig
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Status

LIMIT = 5.0**0.5


@dataclass
class Journey:
    """What came of it."""

    status: Status
    reason: str
    arrived: bool
    distance: float
    waypoints: list[tuple[float, float]]
    plans: list[Plan] = field(default_factory=list)
    decision_ms: list[float] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return len(self.waypoints) - 1


def navigate(
    planner: Planner,
    world: GridMap,
    config: MappingConfig,
    *,
    seed: int = 0,
    max_steps: int = 128,
    rays: int = 720,
    bounded: bool = True,
    on_step: object = None,
) -> Journey:
    """Drive until the target is reached, the planner ends or the steps are used up; every waypoint is checked."""
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=rays), config.sensor_range)
    pose = simulator.reset(world, seed)
    bounds = (*world.origin, world.origin[0] + world.size[0], world.origin[1] + world.size[1])
    assert world.target is not None
    task = NavigationTask(TaskConfig().arrival_radius)
    task.reset(world)
    coverage = Coverage(world)
    mapper = Mapper(
        config, lattice_origin=world.lattice_origin, bounds=bounds if bounded else None, target=world.target
    )
    planner.reset("navigation", world.target, seed)
    journey = Journey(Status.GOING, "step limit", False, 0.0, [pose.position])
    for step in range(max_steps + 1):
        scan = simulator.scan()
        mapper.integrate(scan, pose)
        mapper.update(pose)
        if task.complete(coverage, pose):
            journey.arrived, journey.reason = True, "arrived"
            break
        if step == max_steps:
            break
        started = time.perf_counter()
        plan = planner.plan(mapper, pose)
        journey.decision_ms.append((time.perf_counter() - started) * 1e3)
        if callable(on_step):
            on_step(planner, mapper, pose, plan)
        journey.plans.append(plan)
        journey.status = plan.status
        if plan.status is not Status.GOING:
            journey.reason = plan.reason
            break
        assert plan.waypoint is not None
        length = pose.distance_to(plan.waypoint)
        assert 0.0 < length <= LIMIT * config.viewpoint_spacing + 1e-6, (pose, plan.waypoint)
        assert mapper.segment_free(pose.position, plan.waypoint), (pose, plan.waypoint)
        leg = simulator.drive_to(plan.waypoint)
        assert leg.reached
        pose = leg.pose
        journey.distance += leg.distance
        journey.waypoints.append(pose.position)
    simulator.close()
    return journey
