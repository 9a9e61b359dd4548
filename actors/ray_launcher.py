"""Actors on the machines of a Ray cluster: Ray chooses the places and keeps them; all else is as on one machine.

Experience, weights and statistics go over Zenoh as always, so every machine must reach the learner's endpoint, and
needs an installation of the same version of this project.
"""

from __future__ import annotations

import logging
import os
import time
from types import ModuleType
from typing import Any, Final

from actors.launching import Ended, LocalLauncher, Running
from actors.options import ActorOptions
from actors.process import EXIT_CRASH
from common.errors import ConfigError
from common.system.extras import optional
from common.system.logs import setup_logging

log = logging.getLogger(__name__)

# Stop and start are called while `run` waits for the actor's end.
_THREADS: Final = 2
_POLL_SECONDS: Final = 0.1


class RayLauncher:
    """Starts each actor on one core of a Ray cluster.

    An actor waits in Ray's queue until a core is free, so a cluster that scales itself grows to the number that was
    asked for. One whose machine is lost is placed anew. All end with this process: Ray takes its places back.

    Args:
        address: of the cluster's head, such as ``ray://HOST:10001`` or ``HOST:6379``; None for the environment's
            RAY_ADDRESS, else the cluster that this machine belongs to, else one that consists of this machine.

    Raises:
        ConfigError: Ray is not installed, or no cluster answers.
    """

    def __init__(self, address: str | None) -> None:
        with optional("--launcher ray", "ray", instead="use --launcher local"):
            import ray
        self._ray: ModuleType = ray
        try:
            ray.init(address=address, logging_level=logging.WARNING, log_to_driver=True)
        except (ConnectionError, ValueError, RuntimeError) as error:
            place = address or os.environ.get("RAY_ADDRESS", "this machine")
            raise ConfigError(
                f"no Ray cluster answers at {place}: {error}; start one as docs/cluster.md tells, or give its address "
                "with --ray-address"
            ) from error
        cores = ray.cluster_resources().get("CPU", 0.0)
        log.info("the Ray cluster has %d nodes with %g cores", len(ray.nodes()), cores)
        # Ray is optional, so the class can become one of its actors only here.
        self._seat = ray.remote(num_cpus=1, max_concurrency=_THREADS)(_Seat)

    def start(self, options: ActorOptions) -> Running:
        """Ask for a place for an actor."""
        seat = self._seat.remote()
        end = seat.run.remote(options.model_dump_json())
        return _Placed(self._ray, options.name, seat, end)

    def close(self) -> None:
        """Leave the cluster."""
        self._ray.shutdown()


class _Placed:
    """An actor in the cluster, seen from here."""

    def __init__(self, module: ModuleType, name: str, seat: Any, end: Any) -> None:
        self._ray = module
        self._name = name
        self._seat = seat
        self._end = end
        self._started = time.monotonic()

    def ended(self) -> Ended | None:
        done, _ = self._ray.wait([self._end], timeout=0)
        if not done:
            return None
        try:
            end = Ended(*self._ray.get(self._end))
        except self._ray.exceptions.RayTaskError as error:
            self._ray.kill(self._seat)
            return self._lost(
                "could not be started by its place in the Ray cluster", str(error).strip().splitlines()[-1]
            )
        except self._ray.exceptions.RayError as error:
            # Its machine is gone, or the cluster took the place away.
            return self._lost("lost its place in the Ray cluster", str(error).strip().splitlines()[0])
        self._ray.kill(self._seat)
        return end

    def _lost(self, how: str, error: str) -> Ended:
        return Ended(EXIT_CRASH, how, error, time.monotonic() - self._started)

    def terminate(self) -> None:
        self._seat.stop.remote()

    def kill(self) -> None:
        self._ray.kill(self._seat)


class _Seat:
    """An actor's place, in a process that Ray started: the actor is its child."""

    def __init__(self) -> None:
        setup_logging(None)
        self._launcher = LocalLauncher()
        self._stopped = False

    def run(self, options: str) -> tuple[int, str, str, float]:
        """Run an actor to its end, and return the fields of `Ended`."""
        given = ActorOptions.model_validate_json(options).model_copy(update={"parent": os.getpid()})
        running = self._launcher.start(given)
        while (end := running.ended()) is None:
            time.sleep(_POLL_SECONDS)
            if self._stopped:
                running.terminate()
        return end.code, end.how, end.error, end.seconds

    def stop(self) -> None:
        """Ask the actor to stop."""
        self._stopped = True
