"""What one actor is told when it starts; everything else comes from the learner."""

from __future__ import annotations

import platform
import re
from typing import Literal

from pydantic import BaseModel, ConfigDict

from common.config.schema import BusConfig, RunConfig

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


class ActorOptions(BaseModel):
    """Settings of an actor's own, as the command line gives them; None leaves the run's value.

    Attributes:
        name: name of this actor on the bus.
        run: name of the run.
        bus: endpoints to connect to, and TLS files.
        evaluate: run the validation worlds greedily instead of training.
        simulator: `pybullet` or `grid`.
        fidelity: `kinematic` or `dynamic`.
        maps: sources of worlds.
        gui: open PyBullet's window.
        log_level: of this process.
        parent: process number of the supervisor; the actor ends when that does. 0 for none.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    run: str
    bus: BusConfig
    evaluate: bool = False
    simulator: Literal["pybullet", "grid"] | None = None
    fidelity: Literal["kinematic", "dynamic"] | None = None
    maps: tuple[str, ...] = ()
    gui: bool = False
    log_level: str | None = None
    parent: int = 0

    @property
    def role(self) -> Literal["actor", "evaluator"]:
        """Role on the bus."""
        return "evaluator" if self.evaluate else "actor"

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
