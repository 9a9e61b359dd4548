"""Whether scans from different places contradict each other: a lidar that hangs upside down unsaid mirrors its map."""

from __future__ import annotations

from collections import deque
from math import ceil, pi, remainder
from statistics import median
from typing import Final

from common.geometry import Pose
from deploy.mapping.fit import agreement
from deploy.mapping.log_odds import Beams
from deploy.mapping.measured_grid import MeasuredGrid

# A scan is compared after so much way (metres) or turn (radians), because from one place all scans agree.
_WAY: Final = 0.5
_TURN: Final = 0.2
# So many comparisons count, and so many beams of each.
_LOOKS: Final = 10
_BEAMS: Final = 90
# In one simulated room (test_contradiction.py) the median is 0.99, with people who hide a third of it
# 0.76, of stamps a second late 0.49, of mirrored scans 0.17.
_CONTRADICTS: Final = 0.5


class Contradiction:
    """Compares a scan now and then with the map that earlier ones made; not thread-safe.

    Attributes:
        note: what an operator has to know; empty while scans agree.
    """

    def __init__(self) -> None:
        """Have compared nothing."""
        self.note = ""
        self._last: Pose | None = None
        self._shares: deque[float] = deque(maxlen=_LOOKS)

    def look(self, cells: MeasuredGrid, beams: Beams, sensor: Pose) -> None:
        """Compare a scan, before it is added, where the sensor moved enough since the last one."""
        last = self._last
        if last is None:
            self._last = sensor
            return
        if last.distance_to(sensor.position) < _WAY and abs(remainder(sensor.yaw - last.yaw, 2.0 * pi)) < _TURN:
            return
        self._last = sensor
        each = ceil(len(beams.ranges) / _BEAMS)
        some = Beams(beams.ranges[::each], beams.hits[::each], beams.angles[::each])
        share = None if cells.empty else agreement(cells, some, sensor)
        if share is None:
            return
        self._shares.append(share)
        contradicts = len(self._shares) == _LOOKS and median(self._shares) < _CONTRADICTS
        self.note = (
            "scans contradict each other: less than half of what they show agrees with the map that earlier ones made "
            "from other places. Is the lidar mounted upside down or turned, without a transform on /tf_static or "
            "sensing.sensor_offset that says so? Do lidar and localisation stamp by the same clock, and is the "
            "localisation right?"
            if contradicts
            else ""
        )
