"""The guard before the shipped policies: which worlds, scales and robots are left to a classical planner."""

from __future__ import annotations

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Planner, Position, TaskName
from common.planners.depth import Decider, Depth
from common.planners.registry import make_planner
from common.planners.suited_mapping import of_known_scale
from common.policies.policy_file import PolicyCard
from common.tasks import Task, find_task


class Guard:
    """Lets a classical planner decide where a policy trained on block maps is out of its depth, for one episode.

    That is in worlds of another kind and once the policy dithers (see `Depth`), and throughout where `why_never` says
    so. The classical planner is `tour` in exploration, or `greedy` among trees where the policy dithers; D* Lite in
    navigation, or FAR for a robot with a radius.

    Attributes:
        decisions: made by a classical planner so far.
        decided_by: name of the classical planner that made the last decision; empty where the policy did.
    """

    def __init__(
        self, card: PolicyCard, config: MappingConfig, mapping: MappingConfig, task: TaskName, target: Position | None
    ) -> None:
        """Begin an episode.

        Args:
            card: of the policy.
            config: the mapping of the robot.
            mapping: that of the episode, with utilities and beacons as the policy learnt them.
            task: of the episode.
            target: metres; None in exploration.
        """
        kind = find_task(task)
        self.decisions = 0
        self.decided_by = ""
        self._depth = Depth(
            config, known_scale=not why_never(card, config, task), trained=card.mapping, explores=target is None
        )
        self._decider = Decider.POLICY
        self._names = {decider: deputy(kind, decider, config) for decider in (Decider.REFERENCE, Decider.IN_THE_OPEN)}
        # One planner of a name: what it has planned so far holds whoever asks it.
        self._classical = {name: make_planner(name, mapping) for name in dict.fromkeys(self._names.values())}
        for name, planner in self._classical.items():
            planner.reset(kind.asked_of(name, planner.tasks), target, 0)

    @property
    def planners(self) -> tuple[Planner, ...]:
        """The classical planners that may decide."""
        return tuple(self._classical.values())

    def plan(self, mapper: Mapper, pose: Pose, cycles: int) -> Plan | None:
        """Return the decision of a classical planner, or None where the policy shall decide.

        Args:
            mapper: updated at the pose.
            pose: where the robot stands.
            cycles: decisions of the rule against cycles so far.
        """
        # Off the graph the same one goes on: FAR needs no viewpoint.
        if not mapper.stuck:
            self._decider = self._depth.decider(mapper, cycles)
        if self._decider is Decider.POLICY:
            self.decided_by = ""
            return None
        planner = self._classical[self._names[self._decider]]
        self.decisions += 1
        self.decided_by = planner.name
        return planner.plan(mapper, pose)


def why_never(card: PolicyCard, config: MappingConfig, task: TaskName) -> str:
    """Say in words why a policy shall make no decision at all, whatever the world; empty where it shall.

    Args:
        card: of the policy.
        config: the mapping of the robot.
        task: of the episode.
    """
    if _for_radius(find_task(task), config) is not None:
        return "a robot with a radius drives less by other ways than from viewpoint to viewpoint"
    if not of_known_scale(card, config):
        return "cells, viewpoints or sensor differ in scale from the training of the shipped policy"
    return ""


def deputy(kind: Task, decider: Decider, config: MappingConfig) -> str:
    """Return the name of the classical planner that decides a kind of task in place of a policy."""
    name: str = _for_radius(kind, config) or getattr(kind, decider.value)
    return name


def _for_radius(kind: Task, config: MappingConfig) -> str | None:
    """Return the planner that does a task better for this robot because its ways bend at corners, not at viewpoints."""
    return kind.with_radius if config.robot_radius > 0.0 else None
