"""The learner process: bus, ingest, training, view and local actors, put together and taken apart in order."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Collection
from dataclasses import dataclass

import zenoh
from rich.console import Console

from common.bus.control import ControlServer
from common.bus.experience import ExperienceServer
from common.bus.liveness import PresenceWatcher, Process, declare_presence
from common.bus.session import new_incarnation, open_learner_session, wait_for_routers
from common.bus.spec import SpecServer, specs_of
from common.bus.stats import StatsTable, publish_stats
from common.bus.weights import WeightsPublisher
from common.config import RunConfig
from common.config.names import module_names
from common.errors import BusError
from common.messages.replies import Spec
from common.messages.weights import Weights
from common.page.options import PageSettings, announcement
from common.system.closing import Closing
from common.system.metrics_server import MetricsServer
from common.system.runtime import cores_left, limit_threads
from common.system.signals import stopping_signals
from common.system.threads import Ticker
from learner.algorithm.base import PublishedVersion
from learner.algorithm.device import choose_device
from learner.algorithm.policy_learner import PolicyLearner
from learner.control import Control
from learner.local_actors import LOCAL, LocalActors
from learner.loop import train
from learner.page.process import start_page
from learner.ranks.team import open_learner
from learner.report import Reporter
from learner.rivals import Rivals
from learner.run.folder import RunFolder
from learner.trainer import Trainer
from learner.warmup import warm_up
from learner.watch.prometheus import learner_figures
from learner.watch.status import LearnerStatus
from learner.watch.view import View

logger = logging.getLogger(__name__)

LEARNER = "learner"
RECEIVERS = frozenset({"actor", "evaluator", "robot"})
"""Roles that fetch each version of the weights."""
STATS_SECONDS = 1.0
ROUTER_SECONDS = 3.0
SECOND_SECONDS = 1.0


@dataclass(frozen=True, slots=True)
class Companions:
    """Processes to start beside the learner.

    Attributes:
        actors: number that collect experience.
        evaluators: number that evaluate published versions.
        learners: processes that share each update, the learner's own among them.
        options: further options of `hd-actor`.
        metrics: host and port on which the learner serves its figures for Prometheus; None for none.
        page: how to serve the page; None without one.
    """

    actors: int = 0
    evaluators: int = 0
    learners: int = 1
    options: tuple[str, ...] = ()
    metrics: tuple[str, int] | None = None
    page: PageSettings | None = None


class Link(Closing):
    """The learner's side of the bus: everything that is declared there, closed together.

    Args:
        session: an open session.
        trainer: begun or resumed; deliveries arrive from here on.
        learner: incarnation of this process.
        reporter: makes status records.
    """

    def __init__(self, session: zenoh.Session, trainer: Trainer, learner: int, reporter: Reporter) -> None:
        run, config = trainer.config.name, trainer.config
        self._trainer = trainer
        self._session = session
        self._reporter = reporter
        self._stack = contextlib.ExitStack()
        enter = self._stack.enter_context
        self._learner = learner
        self._refused = 0
        self._presence = enter(PresenceWatcher(session, run))
        self._rivals = enter(Rivals(session, run, learner, time.time() - trainer.uptime))
        self._stats = enter(StatsTable(session, run))
        self._server = self._open_server()
        self._stack.callback(self._close_server)
        enter(ControlServer(session, run, Control(trainer, self.status)))
        enter(SpecServer(session, Spec(run, learner, config.model_dump_json())))
        enter(declare_presence(session, run, "learner", LEARNER))
        enter(Ticker("looking who is on the bus", STATS_SECONDS, self._look_around))
        enter(Ticker("statistics of the learner", STATS_SECONDS, self._tell))

    def status(self) -> LearnerStatus:
        """Describe the learner and everybody on the bus."""
        refused = self._refused + self._server.invalid.total()
        return self._reporter.status(self._presence.present(), self._stats.rows(), refused)

    def close(self) -> None:
        """Take everything off the bus; safe to call twice."""
        self._stack.close()

    def _open_server(self) -> ExperienceServer:
        trainer = self._trainer
        return ExperienceServer(
            self._session,
            trainer.config.name,
            self._learner,
            trainer.ingest.store,
            when_durable=trainer.commit.when_synced if trainer.config.journal.acknowledge == "disk" else None,
            host_of=trainer.ingest.host_of,
        )

    def _close_server(self) -> None:
        self._server.close()

    def _look_around(self) -> None:
        """See who is on the bus: who fetches weights, and whether another learner does."""
        present = self._presence.present()
        self._trainer.receivers = sum(role in RECEIVERS for role, _ in present)
        self._give_way(present)

    def _give_way(self, present: Collection[Process]) -> None:
        """Hold while an earlier learner of the run is in sight, and continue once it is gone."""
        holds = self._rivals.earlier(present)
        if holds == self._trainer.readiness.held:
            return
        self._trainer.readiness.held = holds
        if holds:
            # Deliveries of the actors on this side then find the way to the other learner.
            self._close_server()
        else:
            self._refused += self._server.invalid.total()
            self._server = self._open_server()

    def _tell(self) -> None:
        stats = self._reporter.learner_stats(self.status())
        publish_stats(self._session, self._trainer.config.name, "learner", LEARNER, stats)


def run_learner(run: RunFolder, companions: Companions, console: Console, *, resume: bool) -> None:
    """Train the run in ``run`` until it is complete or told to stop.

    Args:
        run: the run's folder.
        companions: actors to start beside it, and the page.
        console: shared by log and view.
        resume: continue from its newest checkpoint.

    Raises:
        HDError: when the bus cannot be joined, the run cannot be continued, or training diverges.
    """
    config = run.config
    cores = cores_left(companions.actors + companions.evaluators)
    threads = config.learner.threads or max(1, cores // companions.learners)
    limit_threads(threads)
    learner = new_incarnation()
    with contextlib.ExitStack() as stack:
        # The bus comes first: a port that is taken is found before the networks are made.
        session = stack.enter_context(open_learner_session(config.bus))
        refuse_second_learner(session, config, learner)
        device = choose_device(config.learner.device)
        warm_up(config, device)
        publisher = stack.enter_context(WeightsPublisher(session, config.name))

        def publish(version: PublishedVersion) -> None:
            newest = Weights.of(version.weights, learner=learner, version=version.version, updates=version.updates)
            averaged = None
            if version.averaged is not None:
                averaged = Weights.of(
                    version.averaged, learner=learner, version=version.version, updates=version.updates, averaged=True
                )
            publisher.publish(newest, averaged)

        algorithm = stack.enter_context(open_learner(config, device, companions.learners, threads))
        prepare = algorithm.prepare if device.type != "cpu" and isinstance(algorithm, PolicyLearner) else None
        trainer = Trainer(run, algorithm, publish, [LOCAL] if companions.evaluators else [], prepare=prepare)
        stack.callback(trainer.close)
        if resume:
            trainer.resume()
        else:
            trainer.begin()
        reporter = Reporter(trainer, str(device), config.bus.listen)
        link = stack.enter_context(Link(session, trainer, learner, reporter))
        # Once more, now that others see this one: of two that started together neither has seen the other before.
        refuse_second_learner(session, config, learner)
        logger.info("run %s listens on %s", config.name, config.bus.listen)
        if companions.metrics is not None:
            stack.enter_context(MetricsServer(companions.metrics, lambda: learner_figures(link.status())))
        if companions.page is not None:
            page = stack.enter_context(start_page(companions.page, config, run.path))
            # Not into the log, which others may read: it holds the token.
            console.print(announcement(page.address, companions.page), highlight=False, soft_wrap=True)
        for local in _local_actors(run, companions):
            stack.enter_context(local)
        stack.enter_context(View(link.status, console))
        with stopping_signals(trainer.stop, lambda: trainer.stopping):
            train(trainer)
        words = "is complete" if trainer.complete else "was stopped"
        logger.info("run %s %s after %d updates", config.name, words, trainer.limiter.updates)


def refuse_second_learner(session: zenoh.Session, config: RunConfig, learner: int) -> None:
    """Look for another learner of the run on the network.

    Args:
        session: of this learner.
        config: of the run.
        learner: incarnation of this learner.

    Raises:
        BusError: there is one: actors would deliver to either, and each would train on a part.
    """
    if config.bus.connect and not wait_for_routers(session, ROUTER_SECONDS):
        logger.warning("none of the routers %s answers yet: continuing without", ", ".join(config.bus.connect))
    others = [spec for spec in specs_of(session, config.name, SECOND_SECONDS) if spec.learner != learner]
    if others:
        raise BusError(
            f"another learner of run {config.name!r} works on this network: stop it first "
            f"(`hd-learner stop --run {config.name}`), or start this one under another --run"
        )


def _local_actors(run: RunFolder, companions: Companions) -> list[LocalActors]:
    bus, name = run.config.bus, run.config.name
    started = []
    # The configuration is this machine's own, so its actors may load what it names.
    allowed = [word for module in module_names(run.config) for word in ("--allow", module)]
    options = [*companions.options, *allowed]
    if companions.actors:
        started.append(LocalActors(bus, name, companions.actors, LOCAL, options))
    if companions.evaluators:
        options = ["--evaluate", *options]
        started.append(LocalActors(bus, name, companions.evaluators, LOCAL, options))
    return started
