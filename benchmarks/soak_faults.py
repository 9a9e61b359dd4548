"""The faults of the soak: what is broken, what has to be seen, and how soon the robot has to stand."""

from __future__ import annotations

import copy
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.soak_robot import ODOMETRY, SCAN, Spoil
from deploy.ros2 import Message, message
from deploy.ros2.conversions import twist

if TYPE_CHECKING:
    from benchmarks.soak_rig import Rig

# From full speed, and what a busy machine may add; seconds.
_BRAKE: Final = 0.4
_BUSY: Final = 0.6


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong, and what is owed.

    Attributes:
        name: in words.
        expected: what the bridge, the watchdog or the log must say; one is enough, none means nothing.
        limit: seconds in which the robot must stand; None where it need not.
        lasts: seconds until it is over.
        broken: breaks it on entering and mends it on leaving.
        holds: the robot must not move again before it is over.
        restart: seconds until the robot must drive again.
    """

    name: str
    expected: tuple[str, ...]
    limit: float | None
    lasts: float
    broken: Callable[[Rig], Iterator[None]]
    holds: bool = True
    restart: float = 45.0


def _spoilt(kind: str, make: Callable[[], Spoil]) -> Callable[[Rig], Iterator[None]]:
    def broken(rig: Rig) -> Iterator[None]:
        rig.robot.node.spoil[kind] = make()
        yield
        del rig.robot.node.spoil[kind]

    return broken


def _repeated(*, new_stamps: bool) -> Spoil:
    first: list[Message] = []

    def spoil(sent: Message) -> Message:
        first.append(sent)
        again = copy.copy(first[0])
        if new_stamps:
            again.header = sent.header
        del first[1:]
        return again

    return spoil


def _ranges(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    def spoil(sent: Message) -> Message:
        sent.ranges = np.asarray(change(np.array(sent.ranges)), np.float32)
        return sent

    return spoil


def _stretched(sent: Message) -> Message:
    sent.angle_increment *= 1.1
    return sent


def _stuck_pose() -> Spoil:
    first: list[Message] = []

    def spoil(sent: Message) -> Message:
        first.append(sent.pose)
        sent.pose = first[0]
        del first[1:]
        return sent

    return spoil


def _jumped(sent: Message) -> Message:
    sent.pose.pose.position.x += 3.0
    return sent


def _lost(sent: Message) -> None:
    del sent


def _clock(step: float) -> Callable[[Rig], Iterator[None]]:
    def broken(rig: Rig) -> Iterator[None]:
        # A clock that was set stays so.
        rig.robot.node.clock += step
        yield

    return broken


def _cut(rig: Rig) -> Iterator[None]:
    rig.link.cut()
    yield
    rig.link.mend()


def _dropped(rig: Rig) -> Iterator[None]:
    rig.link.drop()
    yield


def _stopped(find: Callable[[Rig], int]) -> Callable[[Rig], Iterator[None]]:
    def broken(rig: Rig) -> Iterator[None]:
        process = find(rig)
        rig.send_signal(process, signal.SIGSTOP)
        yield
        rig.send_signal(process, signal.SIGCONT)

    return broken


def _killed_bridge(rig: Rig) -> Iterator[None]:
    rig.send_signal(rig.bridge.pid, signal.SIGKILL)
    yield
    rig.start_bridge()


def _killed_watchdog(rig: Rig) -> Iterator[None]:
    rig.send_signal(rig.watchdog_pid(), signal.SIGKILL)
    yield


def _emergency_stop(rig: Rig) -> Iterator[None]:
    rig.publish("emergency_stop", message("std_msgs/msg/Bool", data=True))
    yield
    rig.release()


def _sticks(rig: Rig) -> Iterator[None]:
    rig.publish("joy", message("sensor_msgs/msg/Joy", axes=[0.0, 0.8, 0.0, 0.0, 0.0]))
    yield
    rig.publish("joy", message("sensor_msgs/msg/Joy", axes=[0.0] * 5))


def _second_publisher(rig: Rig) -> Iterator[None]:
    with rig.intruder() as publisher:
        publisher.publish(twist(0.0, 0.0))
        yield


def _second_bridge(rig: Rig) -> Iterator[None]:
    rig.try_second_bridge()
    yield


SLOW: Final = 1.0 + _BRAKE + _BUSY
"""Seconds to standstill where a time-out of 1 s decides (`safety.scan_timeout`, `safety.pose_timeout`)."""
SOON: Final = 0.3 + _BRAKE + _BUSY
"""Where three messages or `safety.bridge_timeout` decide."""
BASE: Final = 0.5 + _BRAKE + _BUSY
"""Where the base's own time-out decides."""
AT_ONCE: Final = _BRAKE + _BUSY
WATCHDOG: Final = 0.6 + _BRAKE + _BUSY
"""Where the watchdog's reports are missed."""


def _scans(make: Callable[[], Spoil]) -> Callable[[Rig], Iterator[None]]:
    return _spoilt(SCAN, make)


def _poses(make: Callable[[], Spoil]) -> Callable[[Rig], Iterator[None]]:
    return _spoilt(ODOMETRY, make)


def _no_range(ranges: np.ndarray) -> np.ndarray:
    return np.full_like(ranges, np.nan)


def _ten_ranges(ranges: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(ranges)) < 10, ranges, np.nan)


_SAME_STAMP: Final = _scans(lambda: _repeated(new_stamps=False))
_SAME_SCAN: Final = _scans(lambda: _repeated(new_stamps=True))
_BRIDGE_HANGS: Final = _stopped(lambda rig: rig.bridge.pid)
_WATCHDOG_HANGS: Final = _stopped(lambda rig: rig.watchdog_pid())

FAULTS: Final = (
    Fault("scans come with the same stamp", ("sensor_frozen",), SLOW, 4.0, _SAME_STAMP),
    Fault("e-stop, and its release", ("emergency_stop",), AT_ONCE, 3.0, _emergency_stop),
    Fault("the bridge is stopped (SIGSTOP)", ("bridge_silent",), SOON, 3.0, _BRIDGE_HANGS),
    Fault("all ranges are NaN", ("sensor_blind",), SOON, 4.0, _scans(lambda: _ranges(_no_range))),
    Fault("the link is cut", ("no velocities",), BASE, 4.0, _cut),
    Fault("the pose stands while the wheels turn", ("pose_frozen",), SLOW, 4.0, _poses(_stuck_pose)),
    Fault("the clock steps back by 1 s", ("clock_set_back",), SOON, 3.0, _clock(-1.0), holds=False),
    Fault("a second publisher of velocities", ("soak_intruder",), None, 4.0, _second_publisher),
    Fault("the bridge is killed and started again", ("bridge_gone",), SOON, 4.0, _killed_bridge, restart=240.0),
    Fault("the same scan with new stamps", ("sensor_frozen",), SLOW, 4.0, _SAME_SCAN),
    Fault("the watchdog is killed", ("watchdog",), None, 3.0, _killed_watchdog),
    Fault("no scans", ("sensor_stale",), SLOW, 4.0, _scans(lambda: _lost)),
    Fault("the pose jumps by 3 m", ("pose_jump",), SOON, 1.0, _poses(lambda: _jumped)),
    Fault("the clock steps back by 10 s", ("clock_set_back",), SOON, 3.0, _clock(-10.0), holds=False),
    Fault("the watchdog is stopped (SIGSTOP)", ("watchdog",), WATCHDOG, 3.0, _WATCHDOG_HANGS, holds=False),
    Fault("angles that do not fit the beams", ("sensor_invalid",), SOON, 4.0, _scans(lambda: _stretched)),
    Fault("an operator moves a stick", ("overridden",), AT_ONCE, 3.0, _sticks),
    Fault("no poses", ("pose_stale",), SLOW, 4.0, _poses(lambda: _lost)),
    Fault("all connections break off", (), None, 3.0, _dropped),
    Fault("a second bridge of the same name", ("refused",), None, 1.0, _second_bridge),
    Fault("10 beams are valid", ("sensor_blind",), SOON, 4.0, _scans(lambda: _ranges(_ten_ranges))),
    Fault("the clock steps forward by 5 s", (), None, 3.0, _clock(5.0)),
)
"""In the order in which they come, over and over."""


@contextmanager
def breaking(fault: Fault, rig: Rig) -> Iterator[None]:
    """Break something for the time of a `with`."""
    steps = fault.broken(rig)
    next(steps)
    try:
        yield
    finally:
        next(steps, None)
