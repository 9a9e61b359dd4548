"""Where a classical planner would go: what a policy with the features `guided` sees in addition to the belief."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.config import ImageScale, MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.observations.observation import MAX_ROUTE, Observation
from common.planners.base import Plan, Planner, Position, TaskName
from common.planners.registry import make_planner
from common.tasks import find_task


class ReferenceRoute:
    """Asks a classical planner at every decision, and writes its route into the observation.

    Usage::

        reference = ReferenceRoute(config.mapping)
        reference.reset("exploration", target=None)
        observation = reference.observe(mapper, pose)

    Args:
        config: the mapping that the planner will be given.

    Attributes:
        plan: what the planner said at the last decision; None before the first.
    """

    def __init__(self, config: MappingConfig) -> None:
        self._config = config
        self._planner: Planner | None = None
        self.plan: Plan | None = None

    def reset(self, task: TaskName, target: Position | None) -> None:
        """Begin an episode: forget everything."""
        kind = find_task(task)
        self._planner = make_planner(kind.reference, self._config)
        self._planner.reset(kind.asked_of(kind.reference, self._planner.tasks), target, 0)
        self.plan = None

    def observe(self, mapper: Mapper, pose: Pose, *, image: ImageScale | None = None) -> Observation:
        """Return the observation of the last update with the route in it; to be called once for each decision.

        The route ends where it leaves the viewpoints that the robot knows: beyond its first 255 of them, at a target,
        or in unknown space.

        Args:
            mapper: updated at the pose.
            pose: where the robot stands.
            image: see `MapView.observe`.
        """
        assert self._planner is not None
        observation = mapper.observe(image=image)
        self.plan = self._planner.plan(mapper, pose)
        if self.plan.waypoint is None:
            return observation
        nodes = mapper.nodes_at(np.array([self.plan.waypoint, *self.plan.path]))
        unknown = np.flatnonzero(nodes < 0)
        nodes = nodes[: unknown[0]] if len(unknown) else nodes
        route = nodes[nodes != mapper.robot][:MAX_ROUTE]
        return replace(observation, route=route.astype(np.uint16))
