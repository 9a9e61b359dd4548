"""Settings of an evaluation: planners, worlds, task and limits, shared by the command, its workers and its journal."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from actors.evaluation.episode import Decider
from actors.evaluation.large.robot import check_physics
from actors.evaluation.omniscient import NAME as OMNISCIENT
from actors.evaluation.omniscient import OmniscientReference
from actors.evaluation.replanning import Replan
from common.config import MappingConfig, SimulatorConfig, TaskConfig
from common.config.names import generators_of
from common.config.section import Length
from common.errors import CheckpointError, ConfigError
from common.extensions import SIMULATORS
from common.planners.base import Planner
from common.planners.registry import PLANNERS, make_planner, planner_names
from common.policies.shipped import shipped_policy
from common.registry import NamedPart
from common.tasks import EXPLORATION, TASKS

# Planners that take a file with weights.
LEARNED = ("hdplanner", "hdplanner-bare")


class EvaluationSettings(BaseModel):
    """Everything that decides what an evaluation's episodes are.

    Attributes:
        maps: sources of worlds.
        limit: number of worlds; None for all of a folder.
        metres_per_pixel: scale of the maps.
        task: what is to be done.
        mapping: what the robot makes of its scans.
        simulator: simulated robot and sensor.
        seed: of planners and simulator.
        time_limit: seconds of processor time for one decision.
        policy: file of the learned planner.
        large: at a large scale, as `hd-eval large` does it: under physics, with a 3D lidar, sensing on the way.
        targets: of a tour, where `large` and the task has targets.
        replan: when the robot decides again; other than at its waypoints alone where it is `large`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    maps: tuple[str, ...]
    limit: Annotated[int, Field(ge=1)] | None = None
    metres_per_pixel: Length = 0.25
    task: TaskConfig = TaskConfig()
    mapping: MappingConfig = MappingConfig()
    simulator: SimulatorConfig = SimulatorConfig(name="grid")
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    time_limit: Annotated[float, Field(gt=0.0)] = 10.0
    policy: str | None = None
    large: bool = False
    targets: Annotated[int, Field(ge=1, le=50)] = 5
    replan: Replan = Replan.WAYPOINTS

    @model_validator(mode="after")
    def _large_has_physics(self) -> EvaluationSettings:
        if self.large:
            check_physics(self.simulator)
        elif self.replan is not Replan.WAYPOINTS:
            raise ValueError(
                f"replan {self.replan.value!r} is for evaluations at a large scale (hd-eval large): elsewhere a robot "
                "decides at its waypoints, leave it out"
            )
        return self

    @property
    def map_task(self) -> str:
        """Name of the task that maps have to suit: the targets of a tour are drawn, so its maps need none."""
        return EXPLORATION.name if self.large else self.task.name

    def fingerprint(self, planner: str) -> dict[str, Any]:
        """Return what a planner's episodes depend on, as plain values: two runs that share it can be joined.

        The number of worlds is no part of it, nor the time limit, nor the policy of other planners. A policy counts by
        what its file holds: the shipped one, or a file of the same name, may be another one tomorrow.
        """
        values = self.model_dump(mode="json", exclude={"limit", "time_limit", "large"})
        if not self.large:
            del values["targets"]
        if self.replan is Replan.WAYPOINTS:
            # Results of earlier versions, which knew nothing else, can be continued.
            del values["replan"]
        return {**values, "policy": self._policy_digest() if planner in LEARNED else None}

    def _policy_digest(self) -> str:
        path = shipped_policy(self.task.kind.plan_as) if self.policy is None else Path(self.policy)
        try:
            return f"sha256:{sha256(path.read_bytes()).hexdigest()[:16]}"
        except OSError as error:
            raise CheckpointError(f"cannot read the policy {path} ({error.strerror}): check --policy") from error

    def episode_seed(self, number: int) -> int:
        """Return the seed of the episode in world `number`, the same for every planner."""
        return int(np.random.SeedSequence([self.seed, number]).generate_state(1)[0])

    def make(self, planner: str) -> Planner | OmniscientReference:
        """Make a planner, or the omniscient reference, by its name; MODULE:CLASS names a planner of one's own.

        Raises:
            ConfigError: there is no such planner, it does not do the task, or something that it needs is missing.
            CheckpointError: the policy cannot be read.
        """
        if planner == OMNISCIENT:
            return OmniscientReference(self.mapping, self.task, self.simulator)
        settings = {"policy": self.policy} if planner in LEARNED else {}
        made = make_planner(planner, self.mapping, **settings)
        try:
            self.asked_of(made)
        except ConfigError as error:
            names = planner_names(self.task.kind.name, self.task.kind.plan_as)
            raise ConfigError(f"{error}; planners for it are: {', '.join([*names, OMNISCIENT])}") from None
        return made

    def asked_of(self, planner: Decider) -> str:
        """Return the name of the task that a planner is asked for; ConfigError when it does not do it."""
        return self.task.kind.asked_of(planner.name, planner.tasks)

    def named_parts(self) -> Iterator[NamedPart]:
        """Yield every simulator, task and generator that the settings name."""
        yield NamedPart("simulator.name", SIMULATORS, self.simulator.name)
        yield NamedPart("task.name", TASKS, self.task.name)
        yield from generators_of("maps", self.maps)


def names_with_summaries() -> dict[str, str]:
    """Return the names of all planners and of the reference, each with a line about it."""
    names = {name: PLANNERS.summary(name) for name in planner_names()}
    return {**names, OMNISCIENT: "reference, no planner: near-shortest route on the known map"}
