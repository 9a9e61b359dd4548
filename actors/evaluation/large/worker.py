"""One worker process of an evaluation at a large scale; `actors.evaluation.worker` describes its messages."""

from __future__ import annotations

from typing import ClassVar

from actors.evaluation.episode import Outcome, Tell
from actors.evaluation.large.episode import Decider, EpisodeRunner, LargeOutcome
from actors.evaluation.large.settings import LargeSettings
from actors.evaluation.large.simulator import NotedSimulator
from actors.evaluation.worker import Worker, main
from actors.maps.grid_map import GridMap
from actors.simulators.base import Simulator

# Targets of the tour in the small world that warms planners up.
WARM_UP_TARGETS = 1


class LargeWorker(Worker):
    """Runs explorations and tours under physics."""

    outcome_kind: ClassVar[type[Outcome]] = LargeOutcome

    def __init__(self, settings: LargeSettings, tell: Tell) -> None:
        self._large = settings
        super().__init__(settings, tell)

    def _make_simulator(self) -> Simulator:
        simulator = NotedSimulator(self._large.simulator, self._large.mapping.sensor_range)
        self._runner = EpisodeRunner(self._large, simulator)
        return simulator

    def _episode(self, planner: Decider, world: GridMap, seed: int, tell: Tell, steps: int | None = None) -> Outcome:
        targets = None if steps is None else WARM_UP_TARGETS
        return self._runner.run(planner, world, seed=seed, tell=tell, steps=steps, targets=targets)


if __name__ == "__main__":
    main(lambda settings, tell: LargeWorker(LargeSettings.model_validate_json(settings), tell))
