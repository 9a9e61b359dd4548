"""The robot of an evaluation at a large scale, and its limit of decisions."""

from __future__ import annotations

from typing import Any

from common.config import SimulatorConfig
from common.errors import ConfigError

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


def check_physics(simulator: SimulatorConfig) -> None:
    """Raise ConfigError where a simulator is not the one that such an evaluation needs."""
    if (simulator.name, simulator.fidelity) != ("pybullet", "dynamic"):
        raise ConfigError(
            "an evaluation at a large scale needs simulator.name = 'pybullet' and simulator.fidelity = 'dynamic', "
            f"got {simulator.name!r} and {simulator.fidelity!r}: use 'hd-eval run' for the others"
        )
    if simulator.lidar_layers != 16:
        raise ConfigError(
            "an evaluation at a large scale needs the 3D lidar: leave simulator.lidar_layers at 16, "
            f"got {simulator.lidar_layers}"
        )
