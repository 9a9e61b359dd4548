"""Yardsticks for a run: ``python -m benchmarks.baselines --maps SOURCE --count 50``.

Mean distance and success of a robot that chooses by chance and of the privileged expert, in the same validation worlds
and the same environment that an evaluating actor uses.
"""

from __future__ import annotations

import argparse

import numpy as np

from actors.driver import Driver, ExpertDriver, RandomDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import make_expert
from actors.maps.sources import fixed_set, open_sources
from actors.simulators.factory import make_simulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig


def run(
    maps: str = "generator:rooms?width=320&height=240&seed=1000000", count: int = 30, task: str = "exploration"
) -> dict[str, float]:
    """Return mean metres and share of completed episodes of each yardstick."""
    mapping, goal = MappingConfig(), TaskConfig.model_validate({"name": task})
    simulator = make_simulator(SimulatorConfig(name="grid"), mapping.sensor_range)
    expert = make_expert(goal, mapping)
    environment = Environment(simulator, mapping, make_goal(goal), RewardConfig(), goal.max_steps, expert)
    worlds = fixed_set(open_sources([maps], 0.25, goal.name), count)
    drivers: dict[str, Driver] = {"random": RandomDriver(np.random.default_rng(0)), "expert": ExpertDriver()}
    figures = {}
    for name, driver in drivers.items():
        reports = [
            run_episode(environment, world, driver, Role("evaluate", "grid"), seed=index)
            for index, world in enumerate(worlds)
        ]
        done = [report for report in reports if report is not None]
        figures[f"{name} m"] = float(np.mean([report.distance for report in done]))
        figures[f"{name} completed"] = float(np.mean([report.success for report in done]))
    simulator.close()
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", default="generator:rooms?width=320&height=240&seed=1000000", help="source of worlds")
    parser.add_argument("--count", type=int, default=30, help="number of worlds")
    parser.add_argument("--task", default="exploration", choices=["exploration", "navigation"])
    arguments = parser.parse_args()
    for label, value in run(arguments.maps, arguments.count, arguments.task).items():
        print(f"{label:<30} {value:10.2f}")
