"""A training as the source of a page: what its learner and actors tell, and the commands to the learner."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from common.bus.session import open_client_session, open_viewer_session
from common.bus.views import ViewWatcher
from common.config import BusConfig
from common.errors import BusError, MessageError
from common.page.hub import Hub
from common.page.source import Command, Source
from common.system.steady_time import steady_time
from common.system.threads import Ticker
from learner.page.curves import CurveChannels, Point
from learner.page.episodes import Evaluations, LiveViews
from learner.watch.asking import ask_learner
from learner.watch.status import LearnerStatus

log = logging.getLogger(__name__)

ASK_SECONDS: Final = 1.0
MAX_ACTORS: Final = 1_000
"""Actors that are told one by one."""
_ANSWER_SECONDS: Final = 5.0
_CHECKPOINT_SECONDS: Final = 65.0
# A learner with thousands of actors takes long to tell of them: at most this share of its time goes into that.
_SHARE: Final = 0.05
_TRAIN: Final = ("train", "evaluate")


class Training(Source):
    """One run: its learner is asked once a second, its actors' episodes are looked at while a browser does.

    Its channels are in docs/page.md.
    """

    verbs = ("pause", "resume", "checkpoint", "stop")
    urgent = ("stop",)

    def __init__(self, bus: BusConfig, connect: Sequence[str] | None, run: str, folder: Path | None = None) -> None:
        """Join the bus of a run.

        Args:
            bus: lease and TLS files.
            connect: endpoints of the learner; those of ``bus`` when None.
            run: name of the run.
            folder: of the run, where it lies on this machine: it tells of the time before the page.

        Raises:
            BusError: an endpoint is malformed, or a file is missing.
        """
        self._run = run
        self._folder = folder
        self._session = open_client_session(bus, connect)
        self._bus = bus
        self._connect = connect
        self._watcher: ViewWatcher | None = None
        self._views = LiveViews()
        self._evaluations = Evaluations()
        self._curves = CurveChannels()
        self._begun = False
        self._status: LearnerStatus | None = None
        self._shown: LearnerStatus | None = None
        self._problem = ""
        self._heard = 0.0
        self._patience = 0.0
        self._evaluated = -1
        self._asking = Ticker("asking the learner", ASK_SECONDS, self._ask)

    def refresh(self, hub: Hub) -> None:
        """Put what the learner and its actors told since the last time."""
        if not self._begun:
            self._begun = True
            self._begin(hub)
        status, problem = self._status, self._problem
        alive = [actor.role for actor in status.actors if actor.alive] if status else []
        hub.put(
            "run",
            {
                "name": self._run,
                "problem": problem,
                "silent": self._silence() if problem else 0,
                "alive": {role: alive.count(role) for role in ("actor", "evaluator")},
                "gone": len(status.actors) - len(alive) if status else 0,
            },
        )
        if status is None:
            return
        if status is not self._shown:
            self._shown = status
            values = status.to_json()
            # Those that are gone or came again first, where there are too many for a browser.
            told = sorted(values.pop("actors"), key=lambda each: (each["alive"], -each["restarts"]))[:MAX_ACTORS]
            hub.put("actors", sorted(told, key=lambda each: str(each["name"])))
            hub.put("status", values)
            self._curves.add(hub, self._point(status))
        watcher = self._watcher
        if watcher is not None:
            self._views.refresh(hub, watcher, {actor.name: actor.role for actor in status.actors})
            self._evaluations.add(hub, watcher.outcomes())

    def carry_out(self, command: Command) -> Mapping[str, Any]:
        """Pass a command on to the learner and return its status.

        Raises:
            BusError: it does not answer, or refuses.
        """
        patience = _CHECKPOINT_SECONDS if command.verb == "checkpoint" else _ANSWER_SECONDS
        status = ask_learner(self._session, self._run, command.verb, patience)
        return {"state": status.state, "updates": status.updates, "last_checkpoint": status.last_checkpoint}

    def close(self) -> None:
        """Leave the bus; safe to call twice."""
        self._asking.close()
        self._look_away()
        if not self._session.is_closed():
            self._session.close()

    def _begin(self, hub: Hub) -> None:
        if self._folder is None:
            return
        # Imported here: TensorBoard's messages take a second to load, and a run elsewhere needs none of them.
        from learner.page.history import read_evaluations, read_points

        self._curves.load(hub, read_points(self._folder))
        self._evaluations.load(hub, read_evaluations(self._folder))

    def _ask(self) -> None:
        began = time.monotonic()
        if began < self._patience:
            return
        try:
            self._status = ask_learner(self._session, self._run, "status", _ANSWER_SECONDS)
        except (BusError, MessageError) as error:
            if not self._problem:
                log.warning("%s", error)
            self._problem = str(error)
            self._look_away()
            return
        if self._watcher is None:
            self._watcher = ViewWatcher(open_viewer_session(self._bus, self._connect), self._run)
        self._problem = ""
        self._heard = time.monotonic()
        self._patience = self._heard + (self._heard - began) / _SHARE - ASK_SECONDS

    def _look_away(self) -> None:
        """Leave the actors; a learner that comes again is looked at anew."""
        watcher, self._watcher = self._watcher, None
        if watcher is not None:
            watcher.close()

    def _silence(self) -> int:
        """Seconds since the learner answered last, 0 when it never did."""
        return round(time.monotonic() - self._heard) if self._heard else 0

    def _point(self, status: LearnerStatus) -> Point:
        values = {
            **status.losses,
            "time/updates_per_second": status.updates_per_second,
            "collect/steps_per_second": status.steps_per_second,
            "ratio/actual": status.ratio_actual,
            "replay/fill": status.replay_fill,
        }
        for group in _TRAIN:
            if (means := status.late.get(group)) is not None:
                values |= {f"episode_{group}/distance": means.distance, f"episode_{group}/success": means.success}
        if status.evaluated != self._evaluated:
            self._evaluated = status.evaluated
            values |= {f"evaluation/{name}": value for name, value in status.evaluated_figures.items()}
        return Point(steady_time(), status.updates, values)
