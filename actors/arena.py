"""Where episodes take place: the worlds of one family for one task, and what is drawn anew for each episode."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from actors.environment import Environment
from actors.evaluation.episode import run_episode as run_planner
from actors.evaluation.step_limit import step_limit, warn_of_limit
from actors.expert import make_expert
from actors.maps.grid_map import GridMap
from actors.maps.sources import fixed_numbers, open_sources
from actors.simulators.base import Simulator
from actors.tasks import make_goal
from common.config import FamilyConfig, MappingConfig, RunConfig, TaskConfig
from common.errors import ConfigError, MapError
from common.messages.experience import FAILURE
from common.planners.reference import ReferenceRoute
from common.planners.registry import make_planner


@dataclass(frozen=True, slots=True)
class Stage:
    """An episode that is about to begin.

    Attributes:
        world: where.
        environment: made for it.
    """

    world: GridMap
    environment: Environment


class Arena:
    """The worlds of a family, for one task.

    Each episode draws the sensor's range, the spacing of the viewpoints and the robot's radius within the bounds of the
    family, and has the step limit that its world needs.

    Args:
        config: of the run.
        task: of the episodes.
        family: where they take place.
        number: of the family within the run.
        simulator: runs all of them.
        evaluate: draw from the worlds of validation.

    Attributes:
        family: name of the family.
        number: its number.
        task: name of the task.
        share: of all steps, in proportion to the other arenas'.
    """

    def __init__(
        self,
        config: RunConfig,
        task: TaskConfig,
        family: FamilyConfig,
        number: int,
        simulator: Simulator,
        *,
        evaluate: bool,
    ) -> None:
        self.family, self.number, self.task, self.share = family.name, number, task.name, family.share
        if task.kind.needs_target and not config.network.sees_target:
            raise ConfigError(
                f"task {task.name!r} has a target, and the network is not told where it is: set network.features or "
                "network.variant to others"
            )
        self._config = config
        self._settings = family
        self._simulator = simulator
        self._reward = config.reward
        if evaluate:
            # Evaluation reports distance and success; it needs no privileged reward.
            self._reward = config.reward.model_copy(update={"kind": "paper"})
        self._privileged = not evaluate and (config.cloning.enabled or self._reward.privileged)
        unseen = {} if family.unseen_area is None else {"unseen_area": family.unseen_area}
        self._task = task.model_copy(update=unseen)
        sources = config.sources(family, task.name, evaluate=evaluate)
        self.source = open_sources(sources, config.maps.metres_per_pixel, task.name)

    def draw(self, rng: np.random.Generator) -> Stage:
        """Draw a world, and what else the family leaves open.

        Raises:
            MapError: the world cannot be used.
        """
        return self._stage(self.source.draw(rng), self._draw_mapping(rng))

    def fixed_numbers(self, count: int) -> list[int]:
        """Return the numbers of ``count`` worlds for validation, always the same ones."""
        return fixed_numbers(self.source, count)

    def fixed(self, number: int) -> Stage:
        """Return the episode in world ``number`` of the source, the same in every round of evaluation."""
        return self._stage(self.source.world(number), self._draw_mapping(np.random.default_rng(number)))

    def limit_warning(self, count: int) -> str:
        """Return a sentence where `task.max_steps` is too small for some of ``count`` worlds; else an empty one.

        A family with a limit of its own gets what each world needs, and who drives to a target needs far less.
        """
        if self._settings.max_steps is not None or self._task.kind.needs_target:
            return ""
        worlds = []
        for number in fixed_numbers(self.source, count):
            # An unusable map is skipped here as it is when its turn comes.
            with suppress(MapError):
                worlds.append(self.source.world(number))
        return warn_of_limit(worlds, self._task.max_steps, self._config.mapping)

    def classical_distance(self, number: int) -> float:
        """Return how far the classical planner of the task drives in the world of `fixed`, metres."""
        stage = self.fixed(number)
        planner = make_planner(self._task.kind.reference, stage.environment.mapping)
        outcome = run_planner(stage.environment, planner, stage.world, seed=number, time_limit=float("inf"))
        return outcome.distance if outcome.success else FAILURE * outcome.distance

    def _stage(self, world: GridMap, mapping: MappingConfig) -> Stage:
        task, family = self._task, self._settings
        limit = task.max_steps
        if family.max_steps is not None:
            limit = min(family.max_steps, step_limit([world], mapping))
        self._simulator.set_sensor_range(mapping.sensor_range)
        environment = Environment(
            self._simulator,
            mapping,
            make_goal(task),
            self._reward,
            limit,
            make_expert(task, mapping, hints=self._config.hinted) if self._privileged else None,
            ReferenceRoute(mapping) if self._config.network.features == "guided" else None,
            images=self._config.network.image_scale,
        )
        return Stage(world, environment)

    def _draw_mapping(self, rng: np.random.Generator) -> MappingConfig:
        base, family = self._config.mapping, self._settings
        drawn = {
            name: round(float(rng.uniform(*bounds)), 2)
            for name, bounds in (
                ("sensor_range", family.sensor_range),
                ("viewpoint_spacing", family.viewpoint_spacing),
                ("robot_radius", family.robot_radius),
            )
            if bounds is not None
        }
        return base.model_copy(update=drawn).with_planning_set_of(base) if drawn else base
