"""Whether every lidar of a topic still sends sound messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from deploy.safety.faults import Fault, FaultKind
from deploy.tf.stamps import StampOrder

MAX_LIDARS: Final = 16
"""Frames come from outside: of more lidars than a robot can have none is watched by itself."""
# A sensor may spoil a message or two; so many in a row are a fault.
_UNSOUND: Final = 3


@dataclass(slots=True)
class _Lidar:
    """What came from one frame; times in seconds of the monitor's clock."""

    first: float
    arrived: float
    sound: float | None = None
    order: StampOrder = field(default_factory=StampOrder)
    unsound: tuple[int, Fault] | None = None


class SensorWatch:
    """Watches the lidars that share a topic, each known by the frame of its messages.

    One that falls silent, shows nothing or stands still must not be hidden by the others. A frame counts as a lidar's
    once its messages have come for longer than the time-out; the bridge has to be restarted without one that is taken
    away.
    """

    def __init__(self, name: str, timeout: float, *, required: bool = True, awaited: str = "") -> None:
        """Have heard nothing.

        Args:
            name: of the sensor for the operator.
            timeout: seconds.
            required: there has to be one; without, only one that was heard for longer than the time-out counts.
            awaited: where it is waited for, as `Awaited` says.
        """
        self._name = name
        self._required = required
        self._awaited = awaited
        self._timeout = timeout
        self._lidars: dict[str, _Lidar] = {}

    @property
    def heard(self) -> bool:
        """Whether anything came."""
        return bool(self._lidars)

    def order(self, now: float, frame: str) -> StampOrder:
        """Hear a message that came from a frame, and return the stamps of those before it."""
        if frame not in self._lidars and len(self._lidars) >= MAX_LIDARS:
            frame = ""
        lidar = self._lidars.setdefault(frame, _Lidar(now, now))
        lidar.arrived = now
        return lidar.order

    def take(self, now: float, frame: str, fault: Fault | None, *, news: bool) -> None:
        """Take in what the message was that was just heard.

        Args:
            now: seconds.
            frame: of its header.
            fault: what is wrong with it; None when it is sound.
            news: its stamp has advanced.
        """
        lidar = self._lidars.get(frame) or self._lidars[""]
        if fault is not None:
            lidar.unsound = 1 if lidar.unsound is None else lidar.unsound[0] + 1, fault
        elif news:
            lidar.unsound, lidar.sound = None, now

    def fault(self, now: float) -> Fault | None:
        """Say what is wrong with the first lidar with which something is; None while all is well."""
        lidars = tuple(self._lidars.items())
        if self._required:
            if not lidars:
                return Fault(FaultKind.SENSOR_STALE, f"no {self._name} received yet{self._awaited}")
            newest = max(lidar.arrived for _, lidar in lidars)
            if now - newest > self._timeout:
                return Fault(FaultKind.SENSOR_STALE, self._silence("", now - newest))
        for frame, lidar in lidars:
            fault = self._fault_of(lidar, frame if len(lidars) > 1 else "", now)
            if fault is not None:
                return fault
        return None

    def _fault_of(self, lidar: _Lidar, frame: str, now: float) -> Fault | None:
        timeout = self._timeout
        where = f" in the frame {frame!r}" if frame else ""
        if now - lidar.arrived > timeout:
            if lidar.arrived - lidar.first <= timeout:
                return None
            what = self._silence(where, now - lidar.arrived)
            return Fault(FaultKind.SENSOR_STALE, f"{what}: restart that lidar, or the bridge if it was taken away")
        stale = lidar.sound is None or now - lidar.sound > timeout
        if lidar.unsound is not None and (stale or lidar.unsound[0] >= _UNSOUND):
            count, fault = lidar.unsound
            return Fault(fault.kind, f"{fault.reason}{f' ({count} messages in a row{where})' if frame else ''}")
        if not stale:
            return None
        return Fault(
            FaultKind.SENSOR_FROZEN,
            f"messages of {self._name}{where} arrive, but their stamp has not advanced beyond {lidar.order.newest} s "
            f"for {timeout:g} s",
        )

    def _silence(self, where: str, seconds: float) -> str:
        return f"no {self._name}{where} for {seconds:.1f} s (limit {self._timeout:g} s)"
