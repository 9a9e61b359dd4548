"""Defaults of the simulated robot that its command line shows; what they mean says `RobotOptions`."""

from __future__ import annotations

from typing import Final

MAP: Final = "generator:office?width=192&height=192&seed=3"
METRES_PER_PIXEL: Final = 0.1875
"""Doors of a generated office are 8 pixels wide and must let viewpoints 1 m apart through."""
RAYS: Final = 720
SCAN_RATE: Final = 10.0
COMMAND_TIMEOUT: Final = 0.5
MAX_SPEED: Final = 2.0
MAX_TURN_RATE: Final = 3.0
ACCELERATION: Final = 2.0
DECELERATION: Final = 4.0
TURN_ACCELERATION: Final = 9.0
ODOMETRY_RATE: Final = 30.0
MAP_RATE: Final = 1.0
