"""Runs single episodes with the settings of an evaluation."""

from __future__ import annotations

from actors.environment import Environment
from actors.evaluation.episode import Decider, Tell, run_episode, tell_nobody
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.outcome import Outcome
from actors.evaluation.replanning import Replan
from actors.evaluation.settings import EvaluationSettings
from actors.maps.grid_map import GridMap
from actors.simulators.base import Simulator
from actors.tasks import make_goal
from common.config import RewardConfig
from common.planners.base import mapping_for


class EpisodeRunner:
    """Runs episodes with one simulator.

    Usage::

        runner = EpisodeRunner(settings, make_simulator(settings.simulator, settings.mapping.sensor_range))
        outcome = runner.run(planner, world, seed=3)
        runner.close()
    """

    def __init__(self, settings: EvaluationSettings, simulator: Simulator) -> None:
        """Set up; `close` closes the simulator."""
        self._settings = settings
        self._simulator = simulator

    def run(
        self, planner: Decider, world: GridMap, *, seed: int, tell: Tell = tell_nobody, steps: int | None = None
    ) -> Outcome:
        """Run one episode.

        Args:
            planner: who decides.
            world: where.
            seed: of simulator and planner.
            tell: see `run_episode`.
            steps: to warm up: limit of decisions in place of the settings'; these then take what they take.

        Raises:
            HDError: the world does not suit, or the planner broke the rules of the protocol.
        """
        environment = self._prepare(planner, world, seed, steps)
        return self._drive(environment, planner, world, seed, tell, steps)

    def close(self) -> None:
        """Release the simulator."""
        self._simulator.close()

    def _prepare(self, planner: Decider, world: GridMap, seed: int, steps: int | None) -> Environment:
        """Return the environment of an episode; the omniscient reference sees the world first."""
        settings = self._settings
        if isinstance(planner, OmniscientReference):
            planner.prepare(world, seed)
        return Environment(
            self._simulator,
            mapping_for(planner, settings.asked_of(planner), settings.mapping),
            make_goal(settings.task),
            RewardConfig(),
            settings.task.max_steps if steps is None else steps,
            replans=settings.replan is Replan.SEEN,
        )

    def _drive(
        self, environment: Environment, planner: Decider, world: GridMap, seed: int, tell: Tell, steps: int | None
    ) -> Outcome:
        limit = self._settings.time_limit if steps is None else float("inf")
        return run_episode(environment, planner, world, seed=seed, time_limit=limit, tell=tell)
