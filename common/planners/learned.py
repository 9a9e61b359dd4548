"""The learned policy as a planner, beside the classical ones."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.config.schema import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.observation import Observation
from common.planners.base import Plan, Position, Status, TaskName
from common.planners.lattice import LONGEST_EDGE, TOLERANCE, check_task
from common.policy_file import PolicyCard, read_policy

log = logging.getLogger(__name__)

# What one visit since the last news takes off the logit of a viewpoint, by the revisit rule.
REVISIT_PENALTY = 1.0


class LearnedPlanner:
    """HDPlanner: hierarchical attention networks choose a beacon and the next viewpoint.

    J. Liang et al.: "HDPlanner: Advancing Autonomous Deployments in Unknown Environments through Hierarchical Decision
    Networks", IEEE Robotics and Automation Letters, 2025. Greedy on the waypoint marginal sum_b pi_b pi_a(. | b).

    With `revisit_penalty` above 0, a rule beside the network lowers the logit of a viewpoint by so much for each visit
    since the last new cells. It is no part of the paper: it ends two-node cycles of greedy policies, and results that
    use it say so in their planner's name.

    Attributes:
        card: what the policy is and where it comes from.
        rule_applied: decisions of this episode in which the rule lowered the logit of a choice.
    """

    def __init__(
        self, config: MappingConfig, *, policy: str | Path | None = None, revisit_penalty: float = 0.0
    ) -> None:
        """Load a policy.

        Args:
            config: the mapping that the planner will be given.
            policy: weights (.safetensors) with their card beside them, as `hd-learner export` writes them.
            revisit_penalty: see above; 0 leaves the network alone.

        Raises:
            ConfigError: no policy is named, or the penalty is negative.
            CheckpointError: the policy cannot be read.
            WeightsError: the weights do not fit the network of the card.
        """
        if policy is None:
            raise ConfigError(
                "planner 'hdplanner' needs a policy: give --policy FILE (.safetensors), as 'hd-learner export' writes "
                "it from a training run; no weights are shipped"
            )
        if not revisit_penalty >= 0.0:
            raise ConfigError(f"planner 'hdplanner': revisit_penalty must be 0 or more, got {revisit_penalty}")
        self._policy, self.card = read_policy(Path(policy).expanduser())
        self._config = config
        self._penalty = revisit_penalty
        _warn_of_other_mapping(self.card, config)
        self._forget()

    @property
    def name(self) -> str:
        """Name by which commands and results files call it; it tells whether the revisit rule is on."""
        return "hdplanner+revisit" if self._penalty else "hdplanner"

    @property
    def tasks(self) -> frozenset[TaskName]:
        """The task that the policy was trained for."""
        return frozenset({"navigation" if self.card.task == "navigation" else "exploration"})

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; greedy decisions need no chance, so the seed changes nothing.

        Raises:
            ConfigError: the policy was trained for the other task.
        """
        del target, seed
        check_task(self.name, self.tasks, task)
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
        if not len(waypoints):
            return Plan(Status.STUCK, reason="the robot's viewpoint has no neighbour")
        self._note_visit(mapper)
        decision = self._policy.decide(
            observation,
            greedy=True,
            rng=self._random,
            waypoint_bias=self._bias(mapper, observation, waypoints),
        )
        waypoint, beacon = mapper.position(decision.waypoint), mapper.position(decision.beacon)
        node = mapper.position(mapper.robot)
        if pose.distance_to(node) > TOLERANCE and not self._direct(mapper, pose, waypoint):
            # A robot beside its viewpoint, and not in line with the next one, drives onto its own first.
            return Plan(Status.GOING, waypoint=node, beacon=beacon, path=[waypoint])
        return Plan(Status.GOING, waypoint=waypoint, beacon=beacon)

    def _forget(self) -> None:
        self._random = np.random.default_rng(0)
        self._visits: dict[Position, int] = {}
        self._known_cells = -1
        self.rule_applied = 0

    def _direct(self, mapper: Mapper, pose: Pose, waypoint: Position) -> bool:
        reach = LONGEST_EDGE * self._config.viewpoint_spacing + TOLERANCE
        return pose.distance_to(waypoint) <= reach and mapper.segment_free(pose.position, waypoint)

    def _note_visit(self, mapper: Mapper) -> None:
        """Count that the robot is at its viewpoint; new cells make all earlier visits void."""
        known = mapper.belief.known_cells
        if known != self._known_cells:
            self._known_cells = known
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


def planner_with_revisit_rule(config: MappingConfig, *, policy: str | Path | None = None) -> LearnedPlanner:
    """Return a learned planner with the revisit rule on; see `LearnedPlanner`."""
    return LearnedPlanner(config, policy=policy, revisit_penalty=REVISIT_PENALTY)


def _warn_of_other_mapping(card: PolicyCard, config: MappingConfig) -> None:
    trained, given = card.mapping.model_dump(), config.model_dump()
    differing = [f"{name} {trained[name]} (here {given[name]})" for name in given if trained[name] != given[name]]
    if differing:
        log.warning("the policy of run %r was trained with another mapping: %s", card.run, ", ".join(differing))
