"""One worker process of an evaluation: runs the episodes that it is given on standard input.

Started as ``python -m actors.evaluation.worker``. The first line on standard input are the settings as JSON
(`EvaluationSettings`), the others are jobs, ``{"planner": NAME, "number": N}``. Events are told on standard output, one
JSON object a line: ``ready`` (takes jobs), ``unusable`` (with the reason), ``warm`` (a planner's first decisions, which
compile its kernels), ``start``, ``decide``, ``drive``, ``moved`` (see `run_episode`), ``done`` (with the outcome).
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import traceback
from dataclasses import asdict
from typing import Any

from actors.evaluation.episode import Decider, Tell
from actors.evaluation.episode_runner import EpisodeRunner
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.outcome import Outcome, Place, crashed
from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worlds import WorldSet
from actors.maps.generators import make_generator
from actors.maps.grid_map import GridMap
from actors.maps.layout import BLOCK
from actors.parent import follow_parent
from actors.simulators.factory import make_simulator
from common.errors import HDError
from common.mapping.warmup import warm_up as warm_up_mapping
from common.planners.base import Planner, with_deputies
from common.system.logs import setup_logging

log = logging.getLogger(__name__)

# A world whose target is out of sight for so many decisions.
WARM_UP_WORLD = 5
WARM_UP_STEPS = 6


class Worker:
    """Runs episodes; planners are made once and kept.

    Args:
        settings: of the evaluation.
        tell: called with events as `run_episode` describes them.

    Attributes:
        worlds: of the evaluation.
    """

    def __init__(self, settings: EvaluationSettings, tell: Tell) -> None:
        self._settings = settings
        self._tell = tell
        self.worlds = WorldSet.open(settings.maps, settings.map_task, settings.metres_per_pixel, settings.limit)
        self._episodes = _make_runner(settings)
        self._planners: dict[str, Planner | OmniscientReference] = {}

    def run(self, planner: str, number: int) -> Outcome:
        """Run the episode of a planner in world `number`; whatever goes wrong in it is told in the outcome."""
        places: list[Place] = []

        def tell(event: str, place: Place | None) -> None:
            if place is not None:
                places.append(place)
            self._tell(event, place)

        try:
            decider = self._planner(planner)
            world = self.worlds.load(number)
            return self._episodes.run(decider, world, seed=self._settings.episode_seed(number), tell=tell)
        except HDError as error:
            return crashed(places, f"{error}")
        except Exception as error:  # noqa: BLE001 - one planner's fault must not end the other episodes
            log.error("planner %s in world %d:\n%s", planner, number, traceback.format_exc().rstrip())
            return crashed(places, f"{type(error).__name__}: {error}")

    def attempt(self, planner: Decider, number: int) -> Outcome:
        """Run the episode of a planner that was made elsewhere in world `number`; what goes wrong is the caller's."""
        return self._episodes.run(planner, self.worlds.load(number), seed=self._settings.episode_seed(number))

    def warm_up(self, planner: Decider) -> None:
        """Let a new planner decide a few times in a small world: compiling its kernels counts for no decision."""
        # Scaled so that one block is one spacing: then every viewpoint of the lattice finds its way.
        scale = self._settings.mapping.viewpoint_spacing / BLOCK
        small = make_generator("rooms", {"width": "320", "height": "240"}).world(WARM_UP_WORLD, scale)
        self._tell("warm", None)
        warm_up_mapping()
        self._try_out(planner, small)
        for deputy in with_deputies(planner)[1:]:
            self._try_out(deputy, small)

    def _try_out(self, planner: Decider, world: GridMap) -> None:
        try:
            self._episodes.run(planner, world, seed=0, steps=WARM_UP_STEPS)
        except Exception as error:  # noqa: BLE001 - a fault shows again, and is reported, in its episodes
            log.warning("planner %s cannot do the warm-up world: %s", planner.name, error)

    def close(self) -> None:
        """Release the simulator."""
        self._episodes.close()

    def _planner(self, name: str) -> Planner | OmniscientReference:
        if name not in self._planners:
            made = self._settings.make(name)
            self.warm_up(made)
            self._planners[name] = made
        return self._planners[name]


def serve() -> int:
    """Take the settings and serve jobs until standard input ends; return the exit code."""
    setup_logging(os.environ.get("HD_LOG_LEVEL", "warning"))
    # Libraries that print must not get into the events: those go to the real standard output, prints to the log.
    events = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    follow_parent(os.getppid(), threading.Event())

    def tell(event: str, value: Any) -> None:
        events.write(json.dumps({"event": event, "value": value}) + "\n")
        events.flush()

    settings = sys.stdin.readline()
    if not settings:
        return 0
    try:
        worker = Worker(EvaluationSettings.model_validate_json(settings), tell)
    except HDError as error:
        tell("unusable", str(error))
        return 1
    tell("ready", None)
    for line in sys.stdin:
        job = json.loads(line)
        tell("done", asdict(worker.run(job["planner"], job["number"])))
    worker.close()
    return 0


def _make_runner(settings: EvaluationSettings) -> EpisodeRunner:
    """Return what runs the episodes of an evaluation; PyBullet is loaded only where it is used."""
    if settings.large:
        from actors.evaluation.large.episode import LargeEpisodeRunner

        return LargeEpisodeRunner(settings)
    return EpisodeRunner(settings, make_simulator(settings.simulator, settings.mapping.sensor_range))


if __name__ == "__main__":
    code = serve()
    sys.stderr.flush()
    os._exit(code)
