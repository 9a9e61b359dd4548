"""What one actor is told when it starts; everything else comes from the learner."""

from __future__ import annotations

import platform
import re
from typing import Literal

from pydantic import BaseModel, ConfigDict

from common.config import BusConfig, RunConfig
from common.config.names import config_from_message
from common.extensions import generator_name


class ActorOptions(BaseModel):
    """Settings of an actor's own, as the command line gives them; None leaves the run's value.

    Attributes:
        name: name of this actor on the bus.
        run: name of the run.
        bus: endpoints to connect to, and TLS files.
        evaluate: run the validation worlds greedily instead of training.
        simulator: name of a simulator, or MODULE:CLASS.
        fidelity: `kinematic` or `dynamic`.
        maps: sources of worlds.
        allow: each MODULE:CLASS that the run's configuration may name.
        gui: open PyBullet's window.
        log_level: of this process.
        metrics: host and port on which it serves its figures for Prometheus; None for none.
        parent: process number of the supervisor; the actor ends when that does. 0 for none.
        restarts: how often the supervisor started it again after it had ended by itself.
        last_error: why it ended the last time, one line.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    run: str
    bus: BusConfig
    evaluate: bool = False
    simulator: str | None = None
    fidelity: Literal["kinematic", "dynamic"] | None = None
    maps: tuple[str, ...] = ()
    allow: tuple[str, ...] = ()
    gui: bool = False
    log_level: str | None = None
    metrics: tuple[str, int] | None = None
    parent: int = 0
    restarts: int = 0
    last_error: str = ""

    @property
    def role(self) -> Literal["actor", "evaluator"]:
        """Role on the bus."""
        return "evaluator" if self.evaluate else "actor"

    def accept(self, text: str) -> RunConfig:
        """Return the configuration that a learner sent as JSON, with this actor's own choices put in.

        Raises:
            MessageError: it is none that this version knows.
            ConfigError: it names a module that this actor's command line does not.
        """
        return config_from_message(text, self._named_here(), "start it with --allow MODULE:CLASS", self.apply)

    def _named_here(self) -> set[str]:
        generators = (generator_name(source) for source in self.maps)
        return {name for name in (self.simulator, *generators, *self.allow) if name is not None}

    def apply(self, config: RunConfig) -> RunConfig:
        """Return a run's configuration with this actor's own choices put in."""
        simulator = {
            name: value for name, value in (("name", self.simulator), ("fidelity", self.fidelity)) if value is not None
        }
        maps = {}
        if self.maps:
            maps["validation" if self.evaluate else "train"] = self.maps
        return config.model_copy(
            update={
                "simulator": config.simulator.model_copy(update=simulator),
                "maps": config.maps.model_copy(update=maps),
            }
        )


def host_name() -> str:
    """Return this machine's name in the form that names on the bus have: lower-case letters, digits and dashes."""
    name = re.sub(r"[^a-z0-9-]+", "-", platform.node().lower().split(".")[0]).strip("-")
    return name[:48] or "host"
