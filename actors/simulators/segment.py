"""Motion of a robot that is carried along a straight segment: no dynamics, stops before walls."""

from __future__ import annotations

import math
from collections.abc import Callable

from actors.simulators.base import Leg, Watch
from common.errors import SimulatorError
from common.geometry import Pose, Scan

# A blocked robot stops this far from the wall, metres: less than half a cell of the usual maps, so it stays in the
# free cell before the wall.
STOP_BEFORE_WALL = 0.1


def check_waypoint(waypoint: tuple[float, float]) -> tuple[float, float]:
    """Return the waypoint as two finite floats; `SimulatorError` otherwise."""
    x, y = float(waypoint[0]), float(waypoint[1])
    if not (math.isfinite(x) and math.isfinite(y)):
        raise SimulatorError(f"expected a waypoint of two finite coordinates in metres, got ({x}, {y})")
    return x, y


def follow_segment(
    start: Pose,
    waypoint: tuple[float, float],
    *,
    free_distance: Callable[[Pose, float], float],
    sense: Callable[[Pose], Scan],
    speed: float,
    sense_every: float | None,
    watch: Watch | None = None,
) -> Leg:
    """Carry a robot from ``start`` to ``waypoint`` and scan on the way.

    Args:
        start: where the robot stands.
        waypoint: metres, map frame.
        free_distance: called with a pose and a length; tells how far one can see from there along its yaw, metres,
            infinite when there is no wall within the length.
        sense: scans at a pose on the way.
        speed: metres per second, for the duration of the leg.
        sense_every: metres between scans on the way; None for none.
        watch: takes these scans and may stop the robot; None notes them in the leg.

    Returns:
        The leg. A wall on the segment stops the robot `STOP_BEFORE_WALL` before it: ``reached`` is False and no
        collision is counted, since the robot does not touch it.
    """
    x, y = check_waypoint(waypoint)
    distance = start.distance_to((x, y))
    if distance == 0.0:
        return Leg(pose=start, distance=0.0, duration=0.0, reached=True)
    yaw = math.atan2(y - start.y, x - start.x)
    heading = Pose(start.x, start.y, yaw)
    wall = free_distance(heading, distance)
    reached = wall > distance
    travelled = distance if reached else max(0.0, wall - STOP_BEFORE_WALL)
    sensed: list[tuple[Pose, Scan]] = []
    if sense_every is not None:
        stops = math.ceil(travelled / sense_every - 1e-9) - 1
        for k in range(1, stops + 1):
            pose = _along(heading, k * sense_every)
            scan = sense(pose)
            if watch is None:
                sensed.append((pose, scan))
            elif watch(pose, scan):
                travelled = k * sense_every
                return Leg(pose=pose, distance=travelled, duration=travelled / speed, reached=False, stopped=True)
    return Leg(
        pose=Pose(x, y, yaw) if reached else _along(heading, travelled),
        distance=travelled,
        duration=travelled / speed,
        reached=reached,
        sensed=sensed,
    )


def _along(pose: Pose, distance: float) -> Pose:
    return Pose(pose.x + distance * math.cos(pose.yaw), pose.y + distance * math.sin(pose.yaw), pose.yaw)
