"""Who chooses: a policy, the privileged expert, or chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from actors.environment import Environment
from common.messages.experience import MIN_PROBABILITY
from common.observations.observation import Observation
from common.policies.policy import Policy

NO_VERSION = -1


@dataclass(frozen=True, slots=True)
class Choice:
    """One decision.

    Attributes:
        beacon: node number of the beacon.
        waypoint: node number of the waypoint.
        version: policy version that chose, -1 for a driver without one.
        probability: of the waypoint, whatever the beacon, under the policy that drew it; 0 where none drew.
    """

    beacon: int
    waypoint: int
    version: int
    probability: float = 0.0


class Driver(Protocol):
    """Chooses a beacon and a waypoint for each observation."""

    @property
    def name(self) -> str:
        """Name for reports: `policy`, `expert` or `random`."""
        ...

    @property
    def version(self) -> int:
        """Policy version in use, -1 without one."""
        ...

    def choose(self, observation: Observation, environment: Environment) -> Choice:
        """Choose; only a privileged driver may look into the environment."""
        ...


class PolicyDriver:
    """Follows a policy, by sampling or greedily."""

    name = "policy"

    def __init__(self, policy: Policy, rng: np.random.Generator, *, greedy: bool = False) -> None:
        self.policy = policy
        self._rng = rng
        self._greedy = greedy

    @property
    def version(self) -> int:
        """Version of the policy's weights."""
        return self.policy.version

    def choose(self, observation: Observation, environment: Environment) -> Choice:
        """Ask the policy; the environment is not looked at."""
        del environment
        decision = self.policy.decide(observation, greedy=self._greedy, rng=self._rng)
        probability = 0.0
        if not self._greedy:
            slot = int(np.flatnonzero(observation.waypoint_nodes() == decision.waypoint)[0])
            # The sum over beacons may exceed 1 in its last digit.
            probability = min(float(decision.waypoint_probabilities[slot]), 1.0)
            if probability < MIN_PROBABILITY:
                probability = 0.0
        return Choice(decision.beacon, decision.waypoint, self.policy.version, probability)


class ExpertDriver:
    """Follows the privileged expert: the waypoint of the least cost, and the first beacon of its route."""

    name = "expert"
    version = NO_VERSION

    def choose(self, observation: Observation, environment: Environment) -> Choice:
        """Ask the environment's expert; an expert without a beacon gets the nearest one."""
        expert_label = environment.expert_label()
        waypoint = int(observation.waypoint_nodes()[int(np.argmin(expert_label.cost))])
        beacon = expert_label.beacon if expert_label.beacon >= 0 else nearest_beacon(observation)
        return Choice(beacon, waypoint, NO_VERSION)


class RandomDriver:
    """Chooses evenly among beacons and among waypoints: the baseline of comparisons."""

    name = "random"
    version = NO_VERSION

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def choose(self, observation: Observation, environment: Environment) -> Choice:
        """Draw a beacon and a waypoint."""
        del environment
        beacon = int(self._rng.choice(observation.beacon_nodes()))
        return Choice(beacon, int(self._rng.choice(observation.waypoint_nodes())), NO_VERSION)


def nearest_beacon(observation: Observation) -> int:
    """Return the beacon nearest to the robot in a straight line, the smaller number first."""
    beacons = observation.beacon_nodes()
    steps = observation.steps[beacons]
    return int(beacons[np.argmin(np.hypot(steps[:, 0], steps[:, 1]))])
