"""Settings of an evaluation at a large scale."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from actors.evaluation.settings import EvaluationSettings
from common.config import SimulatorConfig, TaskConfig
from common.errors import ConfigError

WORLD = "generator:building"
# Decisions of an episode (of a leg, on a tour): ten times what is usual, the limit is for planners that circle.
MAX_STEPS = 2_000
TRACKING_ROOM = 0.02
"""Metres that planners keep beyond the robot's radius: a robot with wheels follows a line to a few millimetres, and one
that is led along a corner at exactly its radius grazes it."""
# A 16-line lidar as it is usual in Gazebo: 440 samples a turn. 5 Hz are a scan every 0.4 m at 2 m/s.
LIDAR: dict[str, Any] = {
    "name": "pybullet",
    "fidelity": "dynamic",
    "lidar_layers": 16,
    "rays": 440,
    "lidar_rate": 5.0,
    "speed": 2.0,
}


class LargeSettings(EvaluationSettings):
    """Everything that decides what the episodes are.

    Attributes:
        targets: of a tour, for navigation.
    """

    maps: tuple[str, ...] = (WORLD,)
    task: TaskConfig = TaskConfig(max_steps=MAX_STEPS)
    simulator: SimulatorConfig = SimulatorConfig(**LIDAR)
    targets: Annotated[int, Field(ge=1, le=50)] = 5

    @model_validator(mode="after")
    def _physics(self) -> LargeSettings:
        if (self.simulator.name, self.simulator.fidelity) != ("pybullet", "dynamic"):
            raise ConfigError(
                "an evaluation at a large scale needs simulator.name = 'pybullet' and simulator.fidelity = 'dynamic', "
                f"got {self.simulator.name!r} and {self.simulator.fidelity!r}: use 'hd-eval run' for the others"
            )
        if self.simulator.lidar_layers != 16:
            raise ConfigError(
                "an evaluation at a large scale needs the 3D lidar: leave simulator.lidar_layers at 16, "
                f"got {self.simulator.lidar_layers}"
            )
        return self
