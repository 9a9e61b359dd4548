"""Measure a robot's decision: scans into the map, map into the graph, graph into a waypoint, on one core.

`python -m benchmarks.robot_decision [--planner NAME] [--policy FILE]` drives a point robot at 1 m/s through a building,
with ten noisy scans of 720 beams a second and the bridge's own decision loop. It prints the processor time of the
passes that decided, by the number of reachable viewpoints: wall time on a machine that does nothing else. When the
exploration ends before `--seconds` are over, it prints how far the robot drove.
"""

from __future__ import annotations

import argparse
import time
from math import atan2, cos, sin
from pathlib import Path

import numpy as np

from actors.maps.sources import open_sources
from actors.simulators.grid import GridSimulator
from common.config import MappingConfig, NetworkConfig, SimulatorConfig
from common.errors import SimulatorError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.network.parameters import initial_parameters
from common.planners.base import Plan, Planner
from common.planners.exploration.greedy import GreedyPlanner
from common.planners.learned import LearnedPlanner
from common.policies.policy import Policy
from common.policies.policy_file import PolicyCard
from deploy.bridge.decision import DecisionLoop
from deploy.bridge.mission import Mission
from deploy.bridge.planner_selector import make_planners, with_planning_set
from deploy.bridge.warmup import warm_up
from deploy.config import DeployConfig
from deploy.mapping.robot_map import RobotMap
from deploy.profiles import load_deploy_config
from deploy.safety.health import HealthMonitor

WORLD = "generator:hall?seed=3"
TICK = 0.1
BINS = ((0, 200), (200, 350), (350, 450), (450, 800), (800, 100_000))


class RandomPolicy(GreedyPlanner):
    """A learned planner with random weights decides, as slowly as a trained one of its size; greedy drives.

    Random weights would never get far enough for a large graph. The greedy planner's own time is included.
    """

    def __init__(self, mapping: MappingConfig, width: int, layers: int) -> None:
        """Draw the weights."""
        super().__init__(mapping)
        network = NetworkConfig(width=width, layers=layers, heads=8 if width >= 128 else 4)
        card = PolicyCard("random", "exploration", network, mapping, 0, 0, 0, False, "none", "never")
        self.learned = LearnedPlanner(mapping, policy=(Policy(network, initial_parameters(network, 0)), card))

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Ask both, and return the greedy plan."""
        self.learned.plan(mapper, pose)
        return super().plan(mapper, pose)


def measure(config: DeployConfig, planner: Planner | None, world_source: str, seconds: float) -> np.ndarray:
    """Drive and return (viewpoints, refresh and plan in s, passes without a decision: refresh in s) per pass."""
    world = open_sources([world_source], 0.25, "exploration").world(0)
    mission, health = Mission("exploration"), HealthMonitor(config.safety)
    planners = make_planners(config, planner)
    robot_map = RobotMap(with_planning_set(config, planners))
    warm_up(config, planners.members("exploration"))
    now = 1000.0
    loop = DecisionLoop(
        config.decision, config.mapping, config.safety, robot_map, planners, mission, health, clock=lambda: now
    )
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=720, range_noise=0.02), config.mapping.sensor_range)
    pose = simulator.reset(world, 0)
    mission.start()
    rows, driven = [], 0.0
    for _ in range(int(seconds / TICK)):
        now += TICK
        robot_map.add_pose(now, pose)
        robot_map.add_scan(now, simulator.scan())
        health.heard_sensor(now)
        health.heard_pose(now, now, pose)
        began = time.thread_time()
        outcome = loop.step()
        spent = time.thread_time() - began
        if outcome.mapper is not None:
            rows.append((len(outcome.mapper.viewpoints), spent, float(outcome.decided)))
        if not outcome.orders.moving:
            area = outcome.mapper.explored_area
            print(f"after {len(rows) * TICK:.0f} s and {driven:.0f} m: {outcome.orders.reason}; {area:.0f} m2")
            break
        if outcome.aim is None:
            continue
        aim = outcome.aim
        yaw = atan2(aim[1] - pose.y, aim[0] - pose.x)
        step = min(TICK, pose.distance_to(aim))
        there = Pose(pose.x + step * cos(yaw), pose.y + step * sin(yaw), yaw)
        try:
            simulator.place(there)
        except SimulatorError:
            # A wall that the noisy map does not know to the centimetre: the robot stays, as a real one would.
            continue
        driven += pose.distance_to(there.position)
        pose = there
    return np.array(rows)


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planner", default="greedy", help="name, or random:WIDTHxLAYERS (weights)")
    parser.add_argument("--policy", type=Path, default=None)
    parser.add_argument("--world", default=WORLD)
    parser.add_argument("--seconds", type=float, default=400.0)
    parser.add_argument("--set", action="append", default=[])
    options = parser.parse_args()
    overrides = list(options.set)
    planner = None
    if not options.planner.startswith("random:"):
        overrides.append(f"decision.planner={options.planner}")
    if options.policy is not None:
        overrides.append(f"decision.policy={options.policy}")
    config = load_deploy_config(None, ["driving.enabled=false", *overrides])
    if options.planner.startswith("random:"):
        width, layers = map(int, options.planner.removeprefix("random:").split("x"))
        planner = RandomPolicy(config.mapping, width, layers)
    rows = measure(config, planner, options.world, options.seconds)
    print(f"{options.planner} in {options.world}: {len(rows)} passes, {int(rows[:, 2].sum())} decisions")
    print("| viewpoints | decisions | median ms | p95 ms | max ms | refresh alone, p95 ms |")
    print("| --- | --- | --- | --- | --- | --- |")
    for low, high in BINS:
        chosen = (rows[:, 0] >= low) & (rows[:, 0] < high)
        decided, idle = rows[chosen & (rows[:, 2] > 0), 1] * 1e3, rows[chosen & (rows[:, 2] == 0), 1] * 1e3
        if len(decided) < 5:
            continue
        alone = f"{np.quantile(idle, 0.95):.1f}" if len(idle) else "-"
        print(
            f"| {low} to {high} | {len(decided)} | {np.median(decided):.1f} | {np.quantile(decided, 0.95):.1f} "
            f"| {decided.max():.1f} | {alone} |"
        )


if __name__ == "__main__":
    main()
