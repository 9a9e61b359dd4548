"""The learned policy as a planner."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Position, Status, TaskName
from common.planners.depth import Decider
from common.planners.exploration.greedy import GreedyPlanner
from common.planners.guard import Guard, deputy, why_never
from common.planners.navigation.base import short_of_margin
from common.planners.reference import ReferenceRoute
from common.planners.suited_mapping import warn_of_other_mapping
from common.planners.viewpoint_planner import (
    ON_VIEWPOINT,
    ScannedViewpoints,
    check_task,
    lead_to,
    next_leg,
    nothing_left,
)
from common.planners.visited_places import PlacesSinceGain
from common.policies.policy import Policy
from common.policies.policy_file import PolicyCard, read_policy
from common.policies.shipped import policy_path, shipped_policy, shipped_tasks
from common.tasks import EXPLORATION, find_task

log = logging.getLogger(__name__)


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

    A rule beside the network ends cycles of greedy choices: when the choice is a viewpoint at which the robot has been
    since it last saw something new, the robot goes by the shortest path to a useful viewpoint instead, until it sees
    something new or is there. Which one the classical rules say: in exploration the one that the greedy utility
    planner prefers, in navigation the one of the shortest optimistic way to the target. Every such detour leads to news
    or is done with its goal, so there is an end.

    A `Guard` stands before the shipped policies, which were trained on block maps: in worlds of another kind, for
    robots that they do not suit, and once they dither, a classical planner decides. Policies of one's own have none.

    Rule and guard are no part of the paper, so their decisions are counted, and `hdplanner-bare` is the network without
    either. A policy's file may also hold the network of a learned baseline (docs/baselines.md), to which the same rule
    applies.

    The network reads steps of the lattice, not metres: viewpoints should be as far apart as in training, as a share of
    the sensor's range. Otherwise all that it sees is wider, or more finely divided, than what it was trained on, and a
    warning says so.

    Attributes:
        card: what the policy is and where it comes from; of shipped policies that of the last `reset`, None before.
        policy: the network; weights that it loads hold from the next decision on. Of shipped policies as `card`.
        rule_applied: decisions of this episode that the rule made.
        attention: how probable the choices of the last decision were; None before the first.
    """

    policy: Policy
    rule_applied: int
    attention: Attention | None
    _places: PlacesSinceGain
    _beacon: Position | None
    _reference: ReferenceRoute | None
    _guard: Guard | None

    def __init__(
        self,
        config: MappingConfig,
        *,
        policy: str | Path | tuple[Policy, PolicyCard] | None = None,
        end_cycles: bool = True,
    ) -> None:
        """Load a policy.

        Args:
            config: the mapping that the planner will be given.
            policy: weights (.safetensors) with their card beside them, as `hd-learner export` writes them; without it
                the shipped policy of each task is used. Or a policy that was read already, with its card.
            end_cycles: apply the rule against cycles, and the guard to a shipped policy; otherwise the network is left
                alone.

        Raises:
            CheckpointError: the policy cannot be read, or none is shipped.
            WeightsError: the weights do not fit the network of the card.
        """
        self._config = config
        self._end_cycles = end_cycles
        self._greedy = GreedyPlanner(config)
        self._read: dict[str, tuple[Policy, PolicyCard]] = {}
        self._shipped = policy is None
        self.card: PolicyCard | None = None
        if policy is not None:
            self.policy, self.card = policy if isinstance(policy, tuple) else read_policy(policy_path(policy))
            warn_of_other_mapping(self.card, config)
        elif not shipped_tasks():
            shipped_policy(EXPLORATION.name)
        self._way_out: Position | None = None
        self._forget()

    @property
    def name(self) -> str:
        """Name by which commands and results files call it; it tells whether the rule against cycles is off."""
        return "hdplanner" if self._end_cycles else "hdplanner-bare"

    @property
    def tasks(self) -> frozenset[TaskName]:
        """The tasks that its policy was trained for."""
        return shipped_tasks() if self.card is None or self._shipped else self.card.tasks

    @property
    def guarded(self) -> int:
        """Decisions of this episode that a classical planner made."""
        return 0 if self._guard is None else self._guard.decisions

    @property
    def guarded_by(self) -> str:
        """Name of the classical planner that made the last decision; empty where the policy did."""
        return "" if self._guard is None else self._guard.decided_by

    @property
    def deputies(self) -> tuple[Planner, ...]:
        """The planners of the guard and, in an exploration, of the rule against cycles."""
        guard = () if self._guard is None else self._guard.planners
        return (*guard, self._greedy) if self._end_cycles and self._exploring else guard

    def mapping_for(self, task: TaskName) -> MappingConfig:
        """Return the mapping to give it: the configured one, with utilities and beacons as the policy learnt them.

        Where the guard leaves a whole episode to the classical planner, that one gets its own mapping.
        """
        card = self._read_shipped(task)[1] if self._shipped else self.card
        if card is None or (self._guards(card) and why_never(card, self._config, task)):
            return self._config
        return self._config.with_planning_set_of(card.mapping)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; greedy decisions need no chance, so the seed changes nothing.

        Raises:
            ConfigError: the policy was trained for the other task.
        """
        del seed
        check_task(self.name, self.tasks, task)
        if self._shipped:
            self.policy, self.card = self._read_shipped(task)
        assert self.card is not None
        self._forget()
        self._exploring = target is None
        if self.policy.config.features == "guided":
            reference = ReferenceRoute(self.mapping_for(task))
            reference.reset(task, target)
            self._reference = reference
        elif self._guards(self.card):
            self._guard = Guard(self.card, self._config, self.mapping_for(task), task, target)

    def plan(self, mapper: Mapper, pose: Pose) -> Plan:
        """Decide; the mapper has taken in the newest scan and was updated at this pose."""
        if self._guard is not None:
            plan = self._guard.plan(mapper, pose, self.rule_applied)
            if plan is not None:
                self.attention = None
                return plan
        end = self._end(mapper, pose)
        if end is not None:
            return end
        if self._places.forget_on_gain(mapper):
            self._way_out = None
        self._places.add(mapper.position(mapper.robot))
        detour = self._follow_way_out(mapper, pose)
        if detour is not None:
            return detour
        waypoint = self._decide(mapper, pose)
        if self._end_cycles and mapper.position(waypoint) in self._places:
            self._way_out = self._find_way_out(mapper, pose)
            detour = self._follow_way_out(mapper, pose)
            if detour is not None:
                return detour
        plan = next_leg(mapper, pose, [mapper.robot, waypoint], self._config.viewpoint_spacing)
        if plan.waypoint is not None and plan.waypoint == mapper.target:
            plan = short_of_margin(mapper, pose, plan)
        return replace(plan, beacon=self._beacon)

    def _end(self, mapper: Mapper, pose: Pose) -> Plan | None:
        """Say why there is nothing to decide; None where there is."""
        if mapper.stuck:
            return Plan(Status.STUCK, reason="no viewpoint can be reached in a straight free line from the robot")
        observation = mapper.observe()
        without = Status.UNREACHABLE if observation.has_target else Status.COMPLETE
        if not len(observation.beacon_nodes()):
            return nothing_left(mapper, without)
        self._scanned.note(mapper, pose)
        if not observation.target_known and not len(self._scanned.candidates(mapper)):
            return nothing_left(mapper, without)
        if not len(observation.waypoint_nodes()):
            # What is to be seen is seen from the only viewpoint there is.
            plan = next_leg(mapper, pose, [mapper.robot], self._config.viewpoint_spacing)
            return plan if plan.waypoint else Plan(Status.STUCK, reason="the robot's viewpoint has no neighbour")
        return None

    def _decide(self, mapper: Mapper, pose: Pose) -> int:
        """Return the node that the network chooses; it notes the beacon and the attention."""
        image = self.policy.config.image_scale
        if self._reference is None:
            observation = mapper.observe(image=image)
        else:
            observation = self._reference.observe(mapper, pose, image=image)
        decision = self.policy.decide(observation, greedy=True, rng=self._random)
        self._beacon = mapper.position(decision.beacon)
        self.attention = Attention(
            _positions(mapper, observation.waypoint_nodes()),
            decision.waypoint_probabilities,
            _positions(mapper, observation.beacon_nodes()),
            decision.beacon_probabilities,
        )
        return decision.waypoint

    def _find_way_out(self, mapper: Mapper, pose: Pose) -> Position | None:
        """Return the goal of a detour: a known target, or a useful viewpoint that was not scanned from, or None."""
        if mapper.target_known:
            return mapper.target
        if self._reference is not None and self._reference.plan is not None:
            return self._reference.plan.beacon
        positions = mapper.viewpoints
        distances = mapper.distances(mapper.robot)
        candidates = self._scanned.candidates(mapper)
        candidates = candidates[np.isfinite(distances[candidates])]
        if not len(candidates):
            return None
        if mapper.target is None:
            return mapper.position(self._greedy.choose(mapper, pose, candidates, positions)[0])
        beyond = np.hypot(*(positions[candidates] - np.array(mapper.target)).T)
        return mapper.position(int(candidates[np.argmin(distances[candidates] + beyond)]))

    def _follow_way_out(self, mapper: Mapper, pose: Pose) -> Plan | None:
        """Return the next leg of a detour, None without one or at its end."""
        if self._way_out is None:
            return None
        if mapper.target_known and self._way_out == mapper.target:
            goal = len(mapper.viewpoints)
        else:
            goal = int(np.argmin(np.hypot(*(mapper.viewpoints - np.array(self._way_out)).T)))
        if goal == mapper.robot or not len(mapper.path(mapper.robot, goal)):
            self._way_out = None
            return None
        self.rule_applied += 1
        plan = lead_to(mapper, pose, [goal], self._config.viewpoint_spacing)
        if plan.waypoint is not None:
            self._scanned.note_attempt(pose, plan.waypoint, mapper.position(goal))
        return plan

    def _read_shipped(self, task: TaskName) -> tuple[Policy, PolicyCard]:
        if task not in self._read:
            self._read[task] = read_policy(shipped_policy(task))
            card = self._read[task][1]
            why = self._guards(card) and why_never(card, self._config, task)
            if why:
                log.info("%s: %s decides", why, deputy(find_task(task), Decider.REFERENCE, self._config))
            else:
                warn_of_other_mapping(card, self._config)
        return self._read[task]

    def _guards(self, card: PolicyCard) -> bool:
        """Whether a guard stands before a policy; one that reads the classical planner's route has that with it."""
        return self._shipped and self._end_cycles and card.network.features != "guided"

    def _forget(self) -> None:
        self._random = np.random.default_rng(0)
        self._scanned = ScannedViewpoints(self._config.viewpoint_spacing)
        self._beacon = None
        self._exploring = True
        self._reference = None
        self._guard = None
        # Viewpoints beside lattice points move a little whenever their surroundings become known better.
        self._places = PlacesSinceGain(ON_VIEWPOINT * self._config.viewpoint_spacing)
        self._way_out = None
        self.rule_applied = 0
        self.attention = None


def _positions(mapper: Mapper, nodes: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.array([mapper.position(node) for node in nodes.tolist()])


def bare_planner(config: MappingConfig, *, policy: str | Path | None = None) -> LearnedPlanner:
    """Return a learned planner without rule and guard; see `LearnedPlanner`."""
    return LearnedPlanner(config, policy=policy, end_cycles=False)
