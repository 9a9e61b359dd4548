"""The contract of a simulated world: what comes back is what a robot would have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from actors.maps.grid_map import GridMap
from common.geometry import Pose, Scan

Watch = Callable[[Pose, Scan], bool]
"""Takes a scan made on the way and its pose, and returns whether the robot shall stop."""


@dataclass(frozen=True, slots=True)
class Leg:
    """What happened on the way to one waypoint.

    Attributes:
        pose: where the robot stands now.
        distance: metres travelled.
        duration: simulated seconds.
        reached: False when the robot gave up (blocked, or the time limit of the leg ran out).
        collisions: contacts with the world that began on this leg.
        sensed: scans made on the way with their poses, oldest first, the arrival excluded; those that a watch took
            are not among them.
        stopped: the robot stopped on its way because its watch said so.
    """

    pose: Pose
    distance: float
    duration: float
    reached: bool
    collisions: int = 0
    sensed: list[tuple[Pose, Scan]] = field(default_factory=list)
    stopped: bool = False


class Simulator(Protocol):
    """A robot in one world.

    Usage::

        pose = simulator.reset(world, seed=3)
        scan = simulator.scan()
        leg = simulator.drive_to((12.0, 8.0))
        simulator.close()
    """

    def set_sensor_range(self, metres: float) -> None:
        """Let the sensor reach so far from the next scan on."""
        ...

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world, put the robot on its start and return its pose."""
        ...

    def scan(self) -> Scan:
        """Scan from where the robot stands."""
        ...

    def drive_to(self, waypoint: tuple[float, float], watch: Watch | None = None) -> Leg:
        """Drive along the straight segment to a waypoint, metres in the map frame.

        Args:
            waypoint: where to stop.
            watch: takes each scan that is made on the way; None notes them in the leg. It is passed only where the
                robot replans on its way.
        """
        ...

    def close(self) -> None:
        """Release the world; safe to call twice."""
        ...
