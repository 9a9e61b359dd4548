"""What an actor does: fetch the run's specification, pull weights, act, deliver, and outlive its learner."""

from __future__ import annotations

import contextlib
import logging
import os
import platform
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import zenoh

from actors.collector import Collector
from actors.options import ActorOptions
from actors.spectators import Spectators
from common.bus.experience import ExperienceSender
from common.bus.liveness import declare_presence
from common.bus.session import open_client_session
from common.bus.spec import fetch_spec
from common.bus.stats import publish_stats
from common.bus.views import ViewPublisher
from common.bus.weights import WeightsPuller
from common.errors import BusError, MapError
from common.messages.experience import Chunk, EpisodeReport
from common.messages.replies import Spec
from common.messages.stats import ActorStats
from common.messages.weights import Weights
from common.network.parameters import parameter_shapes
from common.system.printable import printable
from common.system.threads import Ticker

if TYPE_CHECKING:
    from common.config import RunConfig

log = logging.getLogger(__name__)

POLL_SECONDS = 0.2
FLUSH_SECONDS = 1.0
STATS_SECONDS = 1.0
# Sections by which only a learner works; the others, also those added later, decide what an actor collects.
_LEARNERS = frozenset(
    {"adam", "sac", "ppo", "contrastive", "replay", "learner", "checkpoints", "journal", "tracking", "bus"}
)


@dataclass(slots=True)
class _Parts:
    """What one specification needs, for as long as it holds.

    Attributes:
        learner: incarnation of the learner whose specification this is.
        weights: version in use.
        left_out: numbers of the validation worlds that cannot be used.
    """

    collector: Collector
    sender: ExperienceSender
    puller: WeightsPuller
    learner: int
    weights: Weights | None = None
    left_out: set[int] = field(default_factory=set)


class Worker:
    """One actor.

    Args:
        options: what this actor was told.
        stop: set from outside to end it.

    Attributes:
        options: what this actor was told.
        state: what it does now, one line.
        acted: whether it ever got as far as acting.
        stats: newest statistics, None before it joined the run.
    """

    def __init__(self, options: ActorOptions, stop: threading.Event) -> None:
        self.options = options
        self._stop = stop
        self.state = "starting"
        self.acted = False
        self.stats: ActorStats | None = None

    def run(self) -> None:
        """Act until told to stop; a learner that comes back and asks for other experience is begun with anew."""
        options = self.options
        with (
            open_client_session(options.bus, options.bus.connect or None) as session,
            declare_presence(session, options.run, options.role, options.name),
        ):
            spec = self._wait_for_spec(session)
            while spec is not None:
                spec = self._act(session, spec)

    def _wait_for_spec(self, session: zenoh.Session) -> Spec | None:
        """Return the run's specification as soon as its learner answers; None when told to stop before."""
        said = False
        while not self._stop.is_set():
            try:
                return fetch_spec(session, self.options.run, timeout=1.0)
            except BusError:
                self.state = "waiting for the learner"
                if not said:
                    said = True
                    endpoints = ", ".join(self.options.bus.connect or (self.options.bus.listen,))
                    log.info("waiting for the learner of run %r at %s", self.options.run, endpoints)
        return None

    def _act(self, session: zenoh.Session, spec: Spec) -> Spec | None:
        """Act by one specification; return the next when the configuration changed, None when told to stop."""
        options = self.options
        config = options.accept(spec.config)
        with (
            ExperienceSender(
                session,
                options.run,
                options.name,
                window=config.actor.window,
                buffer=config.actor.buffer_chunks,
                ack_timeout=config.bus.ack_timeout,
            ) as sender,
            WeightsPuller(
                session,
                options.run,
                timer=config.actor.weights_timeout,
                averaged=options.evaluate,
                shapes=parameter_shapes(config.network),
            ) as puller,
            ViewPublisher(session, options.run, options.role, options.name) as views,
        ):

            def deliver(body: Chunk | EpisodeReport) -> None:
                while not sender.send(body, timeout=POLL_SECONDS) and not self._stop.is_set():
                    self.state = "paused: the buffer is full"

            collector = Collector(
                config,
                [config.seed, sender.incarnation],
                deliver,
                role="evaluate" if options.evaluate else "train",
                gui=options.gui,
                spectator=Spectators(options.name, views),
            )
            log.info(
                "joined run %r: %s in %s, %s",
                spec.run,
                config.task_name,
                collector.simulator_name,
                f"evaluating on {len(collector.worlds)} worlds" if options.evaluate else "training",
            )
            parts = _Parts(collector, sender, puller, spec.learner)
            with contextlib.closing(collector), Ticker("statistics", STATS_SECONDS, _Teller(self, session, parts)):
                return self._work(session, spec, parts)

    def _work(self, session: zenoh.Session, spec: Spec, parts: _Parts) -> Spec | None:
        """Run episodes until told to stop, or until a restarted learner asks for other experience."""
        while not self._stop.is_set():
            fresh = self._restarted_learner(session, parts)
            if fresh is not None and not self._collects_the_same(spec, fresh):
                log.warning(
                    "the learner of run %r was restarted with another configuration: starting over; %d messages "
                    "collected with the old one are dropped",
                    spec.run,
                    parts.sender.pending,
                )
                return fresh
            if not self._have_weights(parts):
                continue
            self.acted = True
            if self.options.evaluate:
                self._evaluate(parts)
            else:
                self.state = "acting"
                parts.collector.collect(lambda: self._may_go_on(parts))
        self.state = "stopping"
        parts.sender.flush(FLUSH_SECONDS)
        return None

    def _collects_the_same(self, before: Spec, after: Spec) -> bool:
        """Tell whether two specifications ask for the same experience: a learner may move, or train for longer."""
        if before.config == after.config:
            return True
        old, new = (self.options.accept(spec.config) for spec in (before, after))
        return _of_actors(old) == _of_actors(new)

    def _restarted_learner(self, session: zenoh.Session, parts: _Parts) -> Spec | None:
        """Return the specification of a learner that was restarted since the last look, else None."""
        newest = parts.puller.latest()
        heard = {parts.sender.learner, parts.learner if newest is None else newest.learner} - {-1, parts.learner}
        if not heard:
            return None
        try:
            spec = fetch_spec(session, self.options.run, timeout=1.0)
        except BusError:
            # It is gone again; what is known holds until it answers.
            return None
        parts.learner = spec.learner
        return spec

    def _have_weights(self, parts: _Parts) -> bool:
        """Load the newest policy version; wait a moment for the first one, or for a new one to evaluate."""
        newest = parts.puller.latest()
        evaluated = self.options.evaluate and newest is not None and newest is parts.weights
        if newest is None or evaluated:
            self.state = "waiting for the first weights" if newest is None else "waiting for a new version"
            parts.puller.wait(POLL_SECONDS, after=newest)
            return False
        self._load(parts, newest)
        return True

    def _load(self, parts: _Parts, weights: Weights) -> None:
        if weights is not parts.weights:
            parts.collector.load(weights.tensors, weights.version, weights.updates)
            parts.weights = weights

    def _may_go_on(self, parts: _Parts) -> bool:
        """Between two decisions: take over new weights, pause as long as the learner asks, heed a stop."""
        newest = parts.puller.latest()
        if newest is not None:
            self._load(parts, newest)
        while (hold := parts.sender.hold) > 0.0 and not self._stop.is_set():
            self.state = "held by the learner"
            self._stop.wait(min(hold, POLL_SECONDS))
        self.state = "acting" if parts.sender.learner_present else "acting, the learner does not answer"
        return not self._stop.is_set()

    def _evaluate(self, parts: _Parts) -> None:
        """Run the present version on every validation world."""
        version = parts.collector.policy.version
        total = len(parts.collector.worlds)
        successes = 0
        distance = 0.0
        driven = 0
        for index in range(total):
            self.state = f"evaluating version {version}: world {index + 1} of {total}"
            try:
                report = parts.collector.evaluate(index, lambda: not self._stop.is_set())
            except MapError as error:
                # The same in every round.
                log.log(logging.DEBUG if index in parts.left_out else logging.WARNING, "left out a world: %s", error)
                parts.left_out.add(index)
                continue
            if report is None:
                return
            driven += 1
            successes += report.success
            distance += report.distance
        if not driven:
            raise MapError("no validation world can be used; the reasons are above")
        log.info(
            "version %d: %d of %d worlds complete, mean distance %.1f m", version, successes, driven, distance / driven
        )


def _of_actors(config: RunConfig) -> tuple[dict[str, Any], bool, float]:
    """Return what of a configuration an actor works by."""
    return config.model_dump(exclude=set(_LEARNERS)), config.labelled, config.bus.ack_timeout


class _Teller:
    """Publishes the statistics of a worker, each time that it is called."""

    def __init__(self, worker: Worker, session: zenoh.Session, parts: _Parts) -> None:
        self._worker = worker
        self._session = session
        self._parts = parts
        self._steps, self._then = parts.collector.steps, time.monotonic()

    def __call__(self) -> None:
        options, parts = self._worker.options, self._parts
        now, steps = time.monotonic(), parts.collector.steps
        rate = (steps - self._steps) / (now - self._then)
        self._steps, self._then = steps, now
        stats = ActorStats(
            actor=options.name,
            host=printable(platform.node())[:64],
            pid=os.getpid(),
            steps=steps,
            episodes=parts.collector.episodes,
            steps_per_second=rate,
            version=-1 if parts.weights is None else parts.weights.version,
            version_age=parts.puller.age,
            buffered=parts.sender.pending,
            state=self._worker.state,
            restarts=options.restarts,
            last_error=options.last_error,
        )
        self._worker.stats = stats
        if not self._session.is_closed():
            publish_stats(self._session, options.run, options.role, options.name, stats)
