"""A policy that follows its learner: weights are taken from the bus as they are published."""

from __future__ import annotations

import logging
import threading
from datetime import datetime
from typing import Any

import zenoh

from common.bus.session import open_client_session
from common.bus.spec import fetch_spec
from common.bus.weights import WeightsPuller
from common.config import BusConfig, MappingConfig, MapsConfig, RunConfig, SimulatorConfig
from common.config.names import config_from_message
from common.errors import BusError, ConfigError, HDError
from common.messages.weights import Weights
from common.network.parameters import parameter_shapes
from common.planners.learned import LearnedPlanner
from common.policies.policy import Policy
from common.policies.policy_file import PolicyCard
from common.system.closing import Closing
from common.system.logs import lasting
from common.tasks import find_task
from deploy.bridge.planner_selector import PlannerSelector
from deploy.config import DecisionConfig

log = logging.getLogger(__name__)


class LivePolicy(Closing):
    """Gives the planners the newest weights of a run; until the first have come, the one that was made decides.

    Usage::

        with LivePolicy(config.decision, config.mapping) as live:
            live.refresh(planners)  # in the decision thread, before every pass

    Attributes:
        version: policy version in use; -1 before the first.
    """

    def __init__(self, decision: DecisionConfig, mapping: MappingConfig) -> None:
        """Begin to look for the learner; nothing waits for it.

        Raises:
            ConfigError: no run is named.
            BusError: a file of TLS is missing.
        """
        if decision.live_run is None:
            raise ConfigError("decision.live_run names no run to follow")
        self._run_name = decision.live_run
        self._task = decision.task
        self._mapping = mapping
        bus: dict[str, Any] = {}
        if decision.live_tls is not None:
            bus = dict(zip(("tls_ca", "tls_certificate", "tls_key"), decision.live_tls, strict=True))
        self._session: zenoh.Session = open_client_session(BusConfig(**bus), decision.live_connect)
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._found: tuple[RunConfig, WeightsPuller] | None = None
        self._used: Weights | None = None
        self._planner: LearnedPlanner | None = None
        self.version = -1
        self._thread = threading.Thread(target=self._look, name="live policy", daemon=True)
        self._thread.start()

    def refresh(self, planners: PlannerSelector) -> None:
        """Load what has come since the last call.

        Weights that do not fit are logged and left alone: the policy in use stays in use.
        """
        with self._lock:
            found = self._found
        weights = None if found is None else found[1].latest()
        if found is None or weights is None or weights is self._used:
            return
        self._used = weights
        try:
            self._load(found[0], weights, planners)
        except HDError as error:
            unused = lasting(lambda: self._used is weights)
            log.error("weights of version %d cannot be used: %s", weights.version, error, extra=unused)
            return
        self.version = weights.version
        log.info("policy version %d of run %r decides", weights.version, self._run_name)

    def close(self) -> None:
        """Stop following."""
        self._stop.set()
        self._thread.join()
        with self._lock:
            if self._found is not None:
                self._found[1].close()
        self._session.close()

    def _load(self, config: RunConfig, weights: Weights, planners: PlannerSelector) -> None:
        if self._planner is not None:
            self._planner.policy.load(weights.tensors, weights.version)
            return
        card = PolicyCard(
            run=self._run_name,
            task=config.task_name,
            network=config.network,
            mapping=config.mapping,
            version=weights.version,
            updates=weights.updates,
            steps=0,
            averaged=weights.averaged,
            commit="live",
            created=datetime.now().astimezone().isoformat(timespec="seconds"),
        )
        policy = Policy(config.network, weights.tensors, weights.version)
        planner = LearnedPlanner(self._mapping, policy=(policy, card))
        planners.main = planner
        self._planner = planner

    def _look(self) -> None:
        """Wait for the learner, and follow its weights once it has told the shape of its network."""
        said = False
        while not self._stop.is_set():
            try:
                spec = fetch_spec(self._session, self._run_name, timeout=1.0)
                config = config_from_message(spec.config, {self._task}, "set decision.task to it", _without_worlds)
            except BusError:
                if not said:
                    log.info("waiting for the learner of run %r", self._run_name)
                said = True
                continue
            except HDError as error:
                log.error("cannot follow run %r: %s", self._run_name, error)
                return
            task = find_task(self._task)
            if {task.name, task.plan_as}.isdisjoint(each.kind.name for each in config.tasks):
                log.error("run %r trains for %s, this robot is to do %s", self._run_name, config.task_name, self._task)
                return
            puller = WeightsPuller(
                self._session, self._run_name, averaged=True, shapes=parameter_shapes(config.network)
            )
            with self._lock:
                self._found = config, puller
            return


def _without_worlds(config: RunConfig) -> RunConfig:
    """Leave out what a robot does not use of a run, and what therefore may name whatever it likes."""
    return config.model_copy(update={"simulator": SimulatorConfig(), "maps": MapsConfig(), "families": ()})
