"""BIT*: batches of random samples and a heuristic search through them, by the Open Motion Planning Library."""

from __future__ import annotations

from math import floor
from types import ModuleType
from typing import Any, Final

import numpy as np

from common.config import MappingConfig
from common.errors import ConfigError
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import CLEAR, FREE, Box, blocker
from common.planners.base import Position
from common.planners.navigation.free_space import FreeSpacePlanner
from common.planners.navigation.possible_space import to_metres
from common.system.extras import optional

# The search stops after this many edges and vertices for each sample that it may draw, whatever the queue holds.
ITERATIONS_PER_SAMPLE: Final = 50


class BitStarPlanner(FreeSpacePlanner):
    """Plan a path by batch informed trees through free and unknown space, from scratch at each decision.

    J. D. Gammell, S. S. Srinivasa, T. D. Barfoot: "Batch Informed Trees (BIT*): Sampling-based Optimal Planning via the
    Heuristically Guided Search of Implicit Random Geometric Graphs", IEEE International Conference on Robotics and
    Automation (ICRA), 2015.

    As published: the algorithm is that of the Open Motion Planning Library, by the authors of the paper: batches of
    samples, later ones only where they can shorten the path found before; the tree grows by the best edge first. The
    state space is the plane, edges are checked exactly on the belief's cells. Around it, and not of the publication:
    unknown space counts as free and each decision plans anew, from nothing, as a planner for static worlds is used in
    unknown ones; of the path, only the part that is known to be free and no longer than one edge of the viewpoint graph
    is driven. The budget is a number of batches and not a time, so that equal seeds give equal paths.
    """

    name = "bit_star"

    def __init__(
        self,
        config: MappingConfig,
        *,
        arrival_radius: float = 0.5,
        samples_per_batch: int = 100,
        batches: int = 4,
        max_batches: int = 32,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            arrival_radius: see `NavigationPlanner`.
            samples_per_batch: samples that are drawn at a time.
            batches: batches of a decision that finds a path among them.
            max_batches: batches of a decision before it gives up, while there is no path.

        Raises:
            ConfigError: a setting is out of range, or OMPL is not installed.
        """
        if samples_per_batch < 1 or not 1 <= batches <= max_batches:
            raise ConfigError(
                "planner 'bit_star': samples_per_batch must be at least 1 and 1 <= batches <= max_batches, got "
                f"{samples_per_batch}, {batches} and {max_batches}"
            )
        super().__init__(config, arrival_radius=arrival_radius)
        self._samples = samples_per_batch
        self._batches = batches
        self._max_batches = max_batches
        self._ompl = load_ompl()

    def begin(self, target: Position, seed: int) -> None:
        """Forget everything; equal seeds give equal samples."""
        super().begin(target, seed)
        self._random = np.random.default_rng(seed)

    def take_in(self, changed: Box | None) -> None:
        """Do nothing: each search starts from scratch, with the grid as it is."""
        del changed

    def route(self, start: Position, goal: Position) -> list[Position] | None:
        """Search with a fresh tree, where there is a way at all: a search for none would not end soon."""
        if not self.space.joined(start, goal):
            return None
        base, geometric, util = self._ompl
        util.RNG.setSeed(int(self._random.integers(1, 1 << 31)))
        information, space = self._space()
        problem = base.ProblemDefinition(information)
        ends = []
        for position in (start, goal):
            state = space.allocState()
            state[0], state[1] = self._plane(position)
            ends.append(state)
        problem.setStartAndGoalStates(ends[0], ends[1], 1e-9)
        problem.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
        search = geometric.BITstar(information)
        search.setProblemDefinition(problem)
        search.setSamplesPerBatch(self._samples)
        search.setup()

        def enough() -> bool:
            # The count includes the batch that is being searched.
            done = search.numBatches() - 1
            solved = problem.hasExactSolution()
            limit = self._batches if solved else self._max_batches
            return bool(done >= limit or search.numIterations() >= ITERATIONS_PER_SAMPLE * self._samples * limit)

        search.solve(base.PlannerTerminationCondition(enough))
        if not problem.hasExactSolution():
            return None
        states = problem.getSolutionPath().getStates()
        points = np.array([(state[0], state[1]) for state in states[1:-1]]).reshape(-1, 2) * SUBCELLS
        return [*to_metres(self.space.world, points), goal]

    def _plane(self, position: Position) -> Position:
        """Return a position in cells of the padded grid."""
        x, y = self.space.world.subcells(position)
        return x / SUBCELLS, y / SUBCELLS

    def _space(self) -> tuple[Any, Any]:
        """Return the plane of the grid with its obstacles, as OMPL wants it."""
        base = self._ompl[0]
        cells = self.space.clear
        flat, (rows, columns) = cells.reshape(-1), cells.shape

        def free(state: Any) -> bool:
            return bool(cells[floor(state[1]), floor(state[0])] == FREE)

        class Segments(base.MotionValidator):  # type: ignore[misc, name-defined]
            """Exact line of sight through cells that are clear."""

            def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
                x0, y0 = round(a[0] * SUBCELLS), round(a[1] * SUBCELLS)
                return bool(blocker(flat, columns, x0, y0, round(b[0] * SUBCELLS), round(b[1] * SUBCELLS)) == CLEAR)

        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        for axis, count in enumerate((columns, rows)):
            bounds.setLow(axis, 1.0)
            bounds.setHigh(axis, count - 1.001)
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        information.setStateValidityChecker(free)
        information.setMotionValidator(Segments(information))
        information.setup()
        return information, space


def load_ompl() -> tuple[ModuleType, ModuleType, ModuleType]:
    """Import OMPL and silence its console; ConfigError when it is missing.

    Returns:
        The modules ``base``, ``geometric`` and ``util``.
    """
    with optional("this planner", "planners", instead="use a planner without it (dstar_lite, astar, far)"):
        from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    return base, geometric, util
