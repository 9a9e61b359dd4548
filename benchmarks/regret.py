"""Regret of policies on the same held-out states: ``python -m benchmarks.regret exploration B.safetensors``.

A policy is a file, or ``exploration`` for the one that ships.

The first policy drives through fresh worlds of each family, drawing its actions, and the privileged expert labels every
state on the way. The regret of a policy is the detour, in metres, of the waypoint that it would choose there.
"""

from __future__ import annotations

import argparse

import numpy as np

from actors.driver import PolicyDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import make_expert
from actors.maps.sources import fixed_set, open_sources
from actors.simulators.factory import make_simulator
from actors.tasks import make_goal
from actors.transition_recorder import TransitionRecorder
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.errors import HDError
from common.messages.experience import Chunk
from common.policies.policy import Policy
from common.policies.policy_file import read_policy
from common.policies.shipped import policy_path

FAMILIES = ("rooms", "office", "warehouse", "tunnel")
# A detour counts at most so many metres, as in imitation.
LARGEST = 40.0


def states(driver: Policy, family: str, worlds: int, steps: int, seed: int) -> list[Chunk]:
    """Return labelled decisions in fresh worlds of a family, ``steps`` of each world at most."""
    mapping, task = MappingConfig(), TaskConfig(name="exploration")
    simulator = make_simulator(SimulatorConfig(name="grid"), mapping.sensor_range)
    environment = Environment(
        simulator,
        mapping,
        make_goal(task),
        RewardConfig(),
        steps,
        make_expert(task, mapping),
        images="spacing",
    )
    found: list[Chunk] = []
    recorder = TransitionRecorder(64, found.append)
    chooser = PolicyDriver(driver, np.random.default_rng(seed))
    for index, world in enumerate(
        fixed_set(open_sources([f"generator:{family}?seed={seed}"], 0.25, task.name), worlds)
    ):
        run_episode(environment, world, chooser, Role("train", "grid"), seed=index, recorder=recorder, label=True)
    simulator.close()
    return found


def regret(policy: Policy, chunks: list[Chunk]) -> np.ndarray:
    """Return the detour of the policy's choice in every state, metres, shape (states,)."""
    found = []
    rng = np.random.default_rng(0)
    for chunk in chunks:
        assert chunk.labels is not None
        first = 0
        for step in range(chunk.steps):
            observation = chunk.observations[step]
            waypoints = observation.waypoint_nodes()
            cost = chunk.labels.cost[first : first + len(waypoints)]
            first += len(waypoints)
            chosen = policy.decide(observation, greedy=True, rng=rng).waypoint
            found.append(min(float(cost[waypoints == chosen][0]), LARGEST))
    return np.array(found)


def run(
    policies: list[str], worlds: int = 3, steps: int = 60, seed: int = 3_000_000
) -> dict[str, dict[str, np.ndarray]]:
    """Return the regret of each policy in every state of each family, metres; by their names, as they were given.

    Raises:
        CheckpointError: a policy cannot be read.
    """
    loaded = [read_policy(policy_path(name))[0] for name in policies]
    figures: dict[str, dict[str, np.ndarray]] = {name: {} for name in policies}
    for family in FAMILIES:
        chunks = states(loaded[0], family, worlds, steps, seed)
        for name, policy in zip(policies, loaded, strict=True):
            figures[name][family] = regret(policy, chunks)
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", help="files, or what ships: exploration; the first one drives")
    parser.add_argument("--worlds", type=int, default=3, help="worlds of each family")
    parser.add_argument("--steps", type=int, default=60, help="decisions in each world at most")
    parser.add_argument("--seed", type=int, default=3_000_000, help="of the worlds")
    arguments = parser.parse_args()
    try:
        table = run(arguments.policies, arguments.worlds, arguments.steps, arguments.seed)
    except HDError as error:
        parser.exit(1, f"error: {error}\n")
    first = next(iter(table.values()))
    print(f"{'mean metres (paired standard error against the first)':<56}")
    print(f"{'policy':<20}" + "".join(f"{f'{family}, {len(first[family])}':>18}" for family in FAMILIES))
    for name, row in table.items():
        cells = []
        for family in FAMILIES:
            rest = row[family] - first[family]
            cells.append(f"{row[family].mean():.2f} ({rest.std() / len(rest) ** 0.5:.2f})")
        print(f"{name:<20}" + "".join(f"{cell:>18}" for cell in cells))
