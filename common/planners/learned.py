"""The learned policy as a planner, beside the classical ones."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.observation import Observation
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.lattice import ScannedViewpoints, check_task, first_legs, nothing_left
from common.policy import Policy
from common.policy_file import PolicyCard, read_policy
from common.shipped import shipped_policy, shipped_tasks

log = logging.getLogger(__name__)

TASKS: tuple[TaskName, ...] = ("exploration", "navigation")

# What one visit since the last news takes off the logit of a viewpoint, by the revisit rule.
REVISIT_PENALTY = 1.0
# New area that counts as news, m2. Noisy ranges make single cells known at almost every step.
NEWS_AREA = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Attention:
    """How probable the choices of a decision were.

    Attributes:
        waypoints: positions of the waypoints to choose from, metres, shape (n, 2).
        waypoint_probabilities: their marginals, float32, shape (n,).
        beacons: positions of the beacons, metres, shape (m, 2).
        beacon_probabilities: float32, shape (m,).
    """

    waypoints: NDArray[np.float64]
    waypoint_probabilities: NDArray[np.float32]
    beacons: NDArray[np.float64]
    beacon_probabilities: NDArray[np.float32]


class LearnedPlanner:
    """HDPlanner: hierarchical attention networks choose a beacon and the next viewpoint.

    J. Liang et al.: "HDPlanner: Advancing Autonomous Deployments in Unknown Environments through Hierarchical Decision
    Networks", IEEE Robotics and Automation Letters, 2025. Greedy on the waypoint marginal sum_b pi_b pi_a(. | b).

    A rule beside the network ends cycles of greedy choices: the logit of a viewpoint is lowered by `revisit_penalty`
    for each visit since the last new area. It is no part of the paper, so the decisions that it touched are counted,
    and `hdplanner-bare` is the network without it.

    Attributes:
        card: what the policy is and where it comes from; of shipped policies that of the last `reset`, None before.
        policy: the network; weights that it loads hold from the next decision on. Of shipped policies as `card`.
        rule_applied: decisions of this episode in which the rule lowered the logit of a choice.
        attention: how probable the choices of the last decision were; None before the first.
    """

    policy: Policy
    attention: Attention | None

    def __init__(
        self,
        config: MappingConfig,
        *,
        policy: str | Path | tuple[Policy, PolicyCard] | None = None,
        revisit_penalty: float = REVISIT_PENALTY,
    ) -> None:
        """Load a policy.

        Args:
            config: the mapping that the planner will be given.
            policy: weights (.safetensors) with their card beside them, as `hd-learner export` writes them; without it
                the shipped policy of each task is used. Or a policy that was read already, with its card.
            revisit_penalty: see above; 0 leaves the network alone.

        Raises:
            ConfigError: the penalty is negative.
            CheckpointError: the policy cannot be read, or none is shipped.
            WeightsError: the weights do not fit the network of the card.
        """
        if not revisit_penalty >= 0.0:
            raise ConfigError(f"planner 'hdplanner': revisit_penalty must be 0 or more, got {revisit_penalty}")
        self._config = config
        self._penalty = revisit_penalty
        self._news_area = NEWS_AREA
        self._held: dict[str, tuple[Policy, PolicyCard]] = {}
        self._shipped = policy is None
        self.card: PolicyCard | None = None
        if policy is not None:
            self.policy, self.card = policy if isinstance(policy, tuple) else read_policy(Path(policy).expanduser())
            _warn_of_other_mapping(self.card, config)
        elif not shipped_tasks():
            shipped_policy("exploration")
        self._forget()

    @property
    def name(self) -> str:
        """Name by which commands and results files call it; it tells whether the revisit rule is off."""
        return "hdplanner" if self._penalty else "hdplanner-bare"

    @property
    def tasks(self) -> frozenset[TaskName]:
        """The tasks that its policy was trained for."""
        trained = shipped_tasks() if self.card is None or self._shipped else self.card.tasks
        return frozenset(task for task in TASKS if task in trained)

    def mapping_for(self, task: TaskName) -> MappingConfig:
        """Return the mapping to give it: the configured one, with utilities and beacons as the policy learnt them."""
        card = self._read_shipped(task)[1] if self._shipped else self.card
        return self._config if card is None else self._config.with_planning_set_of(card.mapping)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; greedy decisions need no chance, so the seed changes nothing.

        Raises:
            ConfigError: the policy was trained for the other task.
        """
        del target, seed
        check_task(self.name, self.tasks, task)
        if self._shipped:
            self.policy, self.card = self._read_shipped(task)
        self._forget()

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose."""
        if mapper.stuck:
            return Plan(Status.STUCK, reason="no viewpoint can be reached in a straight free line from the robot")
        observation = mapper.observe()
        waypoints = observation.waypoint_nodes()
        if not len(observation.beacon_nodes()):
            if observation.has_target:
                return Plan(Status.UNREACHABLE, reason="no reachable viewpoint observes a frontier or the target")
            return Plan(Status.COMPLETE, reason="no reachable viewpoint observes a frontier")
        useful = observation.utility > 0
        self._scanned.note(mapper, pose)
        if not observation.target_known and self._scanned.mask(mapper.viewpoints)[useful].all():
            status = Status.UNREACHABLE if observation.has_target else Status.COMPLETE
            return Plan(status, reason=nothing_left(int(np.count_nonzero(useful))))
        if not len(waypoints):
            return Plan(Status.STUCK, reason="the robot's viewpoint has no neighbour")
        self._note_visit(mapper)
        decision = self.policy.decide(
            observation,
            greedy=True,
            rng=self._random,
            waypoint_bias=self._bias(mapper, observation, waypoints),
        )
        self.attention = Attention(
            np.array([mapper.position(node) for node in waypoints.tolist()]),
            decision.waypoint_probabilities,
            mapper.beacons,
            decision.beacon_probabilities,
        )
        waypoint, beacon = mapper.position(decision.waypoint), mapper.position(decision.beacon)
        route = [mapper.position(mapper.robot), waypoint]
        legs = first_legs(mapper, pose, route, self._config.viewpoint_spacing)
        return Plan(Status.GOING, waypoint=legs[0], beacon=beacon, path=legs[1:])

    def _read_shipped(self, task: TaskName) -> tuple[Policy, PolicyCard]:
        if task not in self._held:
            self._held[task] = read_policy(shipped_policy(task))
            _warn_of_other_mapping(self._held[task][1], self._config)
        return self._held[task]

    def _forget(self) -> None:
        self._random = np.random.default_rng(0)
        self._scanned = ScannedViewpoints(self._config.viewpoint_spacing)
        self._visits: dict[Position, int] = {}
        self._known_area = -math.inf
        self.rule_applied = 0
        self.attention = None

    def _note_visit(self, mapper: Mapper) -> None:
        """Count that the robot is at its viewpoint; new area makes all earlier visits void."""
        known = mapper.belief.known_cells * mapper.belief.resolution**2
        if known >= self._known_area + self._news_area:
            self._known_area = known
            self._visits.clear()
        node = mapper.position(mapper.robot)
        self._visits[node] = self._visits.get(node, 0) + 1

    def _bias(
        self, mapper: Mapper, observation: Observation, waypoints: NDArray[np.int64]
    ) -> NDArray[np.float32] | None:
        """Return what the revisit rule adds to the logits of the waypoints, None when that is nothing."""
        if not self._penalty:
            return None
        visits = [
            0 if node == observation.viewpoints else self._visits.get(mapper.position(node), 0)
            for node in waypoints.tolist()
        ]
        if not any(visits):
            return None
        self.rule_applied += 1
        return np.array(visits, dtype=np.float32) * np.float32(-self._penalty)


def bare_planner(config: MappingConfig, *, policy: str | Path | None = None) -> LearnedPlanner:
    """Return a learned planner without the revisit rule; see `LearnedPlanner`."""
    return LearnedPlanner(config, policy=policy, revisit_penalty=0.0)


def _warn_of_other_mapping(card: PolicyCard, config: MappingConfig) -> None:
    trained, given = card.mapping.model_dump(), config.with_planning_set_of(card.mapping).model_dump()
    scaled = ("utility_range", "min_utility", "least_utility", "beacon_range")
    differing = [
        f"{name} {trained[name]} (here {given[name]})"
        for name in given
        if name not in scaled and trained[name] != given[name]
    ]
    if differing:
        log.warning("the policy of run %r was trained with another mapping: %s", card.run, ", ".join(differing))
