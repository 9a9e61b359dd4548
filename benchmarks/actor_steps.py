"""Measure full actor steps per second on one core, and where their time goes.

`python -m benchmarks.actor_steps [--seconds S] [--map SOURCE]`: one collector without a bus runs training episodes, and
chunks are encoded as for sending. The policy has random weights; it decides every step, but the robot goes to the
nearest useful viewpoint, so that episodes and graphs are as large as those of a trained policy (what that costs is
taken off). Times are processor seconds of this process, so that other work on the machine takes little part; run it
with OMP_NUM_THREADS=1. Targets: 60 steps/s with the paper's network (width 128, 6 layers) in kinematic PyBullet, 250
with width 64 and 3 layers in `grid`.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np

from actors.collector import Collector
from actors.driver import Choice, Driver
from actors.environment import Environment
from actors.robot import Robot
from common.config import RunConfig
from common.messages.experience import Chunk, Delivery, EpisodeReport
from common.messages.schema import encode
from common.observations.observation import Observation

SMALL = {"width": 64, "layers": 3, "heads": 4}
PAPER = {"width": 128, "layers": 6, "heads": 8}
CASES: dict[str, dict[str, Any]] = {
    "grid, d 64": {"simulator": {"name": "grid"}, "network": SMALL},
    "grid, d 128": {"simulator": {"name": "grid"}, "network": PAPER},
    "grid, d 64, labels": {"simulator": {"name": "grid"}, "network": SMALL, "cloning": {"updates": 1}},
    "pybullet kinematic, d 64": {"simulator": {"name": "pybullet"}, "network": SMALL},
    "pybullet kinematic, d 128": {"simulator": {"name": "pybullet"}, "network": PAPER},
    "pybullet dynamic, d 128": {"simulator": {"name": "pybullet", "fidelity": "dynamic"}, "network": PAPER},
}


class Guided:
    """Lets the policy decide, then goes to the nearest useful viewpoint."""

    name = "policy"

    def __init__(self, inner: Driver) -> None:
        self._inner = inner
        self._goal = np.full(2, np.inf)
        self.viewpoints = 0

    @property
    def version(self) -> int:
        """Version of the policy."""
        return self._inner.version

    def choose(self, observation: Observation, environment: Environment) -> Choice:
        """Ask the policy, and do something sensible."""
        self.viewpoints += observation.viewpoints
        self._inner.choose(observation, environment)
        return self.guide(observation, environment)

    def guide(self, observation: Observation, environment: Environment) -> Choice:
        """Return the first waypoint towards the nearest useful viewpoint not visited yet; keep to it until then."""
        mapper = environment.mapper
        distances = mapper.distances(observation.robot)[: observation.viewpoints]
        useful = (observation.utility > 0) & ~observation.visited
        goals = useful & (np.hypot(*(mapper.viewpoints - self._goal).T) < 0.1)
        goal = int(np.argmin(np.where(goals if goals.any() else useful, distances, np.inf)))
        self._goal = mapper.viewpoints[goal]
        path = mapper.path(observation.robot, goal)
        waypoint = path[1] if len(path) > 1 else int(observation.waypoint_nodes()[0])
        return Choice(int(observation.beacon_nodes()[0]), waypoint, self.version)


class Stages(ExitStack):
    """Processor seconds of each stage of a collector, what a stage calls of another left out.

    Closing it takes the clocks away again.
    """

    def __init__(self, collector: Collector) -> None:
        super().__init__()
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = [0.0]
        self.driver = Guided(collector._policy_driver)
        collector._policy_driver = self.driver  # type: ignore[assignment]
        self._wrap(self.driver, "guide", "guide")
        simulator = collector._simulator
        self._wrap(collector.policy, "decide", "policy")
        self._wrap(simulator, "reset", "simulator reset")
        self._wrap(simulator, "drive_to", "drive")
        self._wrap(simulator, "scan", "scan")
        # Each episode has an environment and a robot of its own.
        self._wrap(Robot, "_look", "mapping")
        self._wrap(Robot, "update", "mapping")
        self._wrap(Environment, "_complete", "mapping")
        self._wrap(Environment, "expert_label", "expert")
        for arena in collector._arenas:
            self._wrap(arena.source, "draw", "world")

    def _wrap(self, owner: object, name: str, stage: str) -> None:
        inner: Callable[..., Any] = getattr(owner, name)

        def timed(*arguments: Any, **options: Any) -> Any:
            self._inner.append(0.0)
            began = time.process_time()
            try:
                return inner(*arguments, **options)
            finally:
                spent = time.process_time() - began
                self.seconds[stage] += spent - self._inner.pop()
                self._inner[-1] += spent

        self.enter_context(patch.object(owner, name, timed))


@contextmanager
def opened(settings: dict[str, Any], specs: list[str]) -> Iterator[tuple[Collector, Stages]]:
    """Give a collector whose chunks are encoded and dropped, with its stages."""
    config = RunConfig.model_validate({"maps": {"train": specs}, **settings})
    sequence = 0

    def deliver(body: Chunk | EpisodeReport) -> None:
        nonlocal sequence
        encode(Delivery("bench", 0, sequence, body))
        sequence += 1

    # Never an episode of the expert: it would say nothing about the policy's speed.
    if config.cloning.enabled:
        config = config.model_copy(update={"cloning": config.cloning.model_copy(update={"expert_episodes": 0.0})})
    collector = Collector(config, [0], deliver)
    with closing(collector), Stages(collector) as stages:
        yield collector, stages


def measure(settings: dict[str, Any], specs: list[str], seconds: float) -> tuple[float, float, dict[str, float]]:
    """Return steps per second over whole episodes, mean viewpoints, and milliseconds per step by stage."""
    with opened(settings, specs) as (collector, stages):
        collector.collect()
        stages.seconds.clear()
        stages.driver.viewpoints = 0
        before, began = collector.steps, time.process_time()
        while time.process_time() - began < seconds:
            collector.collect()
        spent = time.process_time() - began - stages.seconds.pop("guide")
        steps = collector.steps - before
        split = {name: 1e3 * value / steps for name, value in stages.seconds.items()}
        split["everything else"] = 1e3 * spent / steps - sum(split.values())
        return steps / spent, stages.driver.viewpoints / steps, split


def run(seconds: float = 10.0, specs: list[str] | None = None, cases: Sequence[str] = tuple(CASES)) -> dict[str, float]:
    """Return steps per second of some cases, and milliseconds per step of their stages."""
    results: dict[str, float] = {}
    for name in cases:
        settings = CASES[name]
        if settings["simulator"]["name"] == "pybullet" and importlib.util.find_spec("pybullet") is None:
            continue
        rate, viewpoints, split = measure(settings, specs or ["generator:rooms"], seconds)
        results[f"{name}: steps/s"] = rate
        results[f"{name}: viewpoints"] = viewpoints
        results.update({f"{name}: {stage} ms": value for stage, value in sorted(split.items()) if value > 0.0})
    return results


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="measuring time of each case")
    parser.add_argument("--map", action="append", help="source of worlds; default generator:rooms")
    arguments = parser.parse_args()
    for name, value in run(arguments.seconds, arguments.map).items():
        print(f"{name:<50} {value:10.2f}")


if __name__ == "__main__":
    main()
