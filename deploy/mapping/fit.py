"""Whether what the robot sees fits the map that it made before its pose leapt.

An odometry that begins anew puts the robot at its origin, wherever it stands, and so does a SLAM or localisation that
tells poses by TF: what it sees from then on would be drawn over the old map, and its home and target would be somewhere
else. So after a leap the first scans are compared with the map before they go into it. Where the robot was really
carried, or its localisation found back to the truth, they fit.
"""

from __future__ import annotations

import logging
from collections import deque
from math import ceil
from statistics import median
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.sight import OCCUPIED, UNKNOWN
from common.system.logs import lasting
from deploy.mapping.log_odds import Beams
from deploy.mapping.measured_grid import MeasuredGrid

log = logging.getLogger(__name__)

# So many scans in a row are compared.
_SCANS: Final = 3
# The map fits where so large a share of the beams that it can judge agree with it: people and moved chairs do not.
_FITS: Final = 0.6
# An obstacle may be so far from where the map has it, metres, and at least one cell.
_NEAR: Final = 0.3
# A map that knows the ends of fewer beams tells nothing.
_FEWEST: Final = 20


class MapFit:
    """Holds scans back while it is in doubt whether the map fits; not thread-safe.

    Attributes:
        problem: why the map is in doubt, for the operator; empty while it is not.

    Usage::

        fit.doubt("the pose jumped 7.30 m")
        for scan, sensor in fit.admit(cells, scan, sensor): ...  # what may go into the map
    """

    def __init__(self) -> None:
        """Trust the map."""
        self.problem = ""
        self._why = ""
        self._misfit = False
        self._held: deque[tuple[Beams, Pose]] = deque(maxlen=_SCANS)
        self._shares: deque[float | None] = deque(maxlen=_SCANS)

    def doubt(self, why: str) -> None:
        """Trust the map no more until scans fit it; scans from before that were held back are not used."""
        self._why = why
        self._held.clear()
        self._shares.clear()
        self.problem = f"{why}: looks whether the map still fits"

    def admit(self, cells: MeasuredGrid | None, beams: Beams, sensor: Pose) -> list[tuple[Beams, Pose]]:
        """Take in a scan and return those that may go into the map now, oldest first.

        A map that knows nothing of what the scans show cannot contradict them, and is trusted; one that was found not
        to fit must fit first.
        """
        if not self.problem:
            return [(beams, sensor)]
        share = None if cells is None or cells.empty else agreement(cells, beams, sensor)
        self._shares.append(share)
        self._held.append((beams, sensor))
        told = [share for share in self._shares if share is not None]
        if len(self._shares) < _SCANS and (told or self._misfit):
            return []
        if told and median(told) < _FITS:
            self.problem = (
                f"{self._why}, and what the robot sees does not fit its map any more (it agrees with "
                f"{median(told):.0%} of the beams): what tells its pose began anew, or lost its way. Put it right, or "
                "send `reset` for a new map; home is forgotten with the old one"
            )
            if not self._misfit:
                self._misfit = True
                log.warning("%s", self.problem, extra=lasting(lambda: self._misfit))
            return []
        if not told and self._misfit:
            return []
        agrees = f"agrees with {median(told):.0%} of the beams" if told else "knows nothing of what is there"
        log.debug("%s, and the map still counts: it %s", self._why, agrees)
        self.problem, self._misfit = "", False
        held = list(self._held)
        self._held.clear()
        return held


def agreement(cells: MeasuredGrid, beams: Beams, sensor: Pose) -> float | None:
    """Return the share of beams that ended where the map has an obstacle, of those that it knows something about.

    It knows about beams that ended in known cells, and about those that would have had to pass through an obstacle.

    Args:
        cells: the map.
        beams: of one scan.
        sensor: where it was made, map frame.

    Returns:
        None where the map knows too little.
    """
    at = np.flatnonzero(beams.hits)
    ends = beams.ends(sensor)
    if not len(ends):
        return None
    reach = max(ceil(_NEAR / cells.resolution), 1)
    around = np.arange(-reach, reach + 1) * cells.resolution
    shifts = np.stack(np.meshgrid(around, around), axis=-1).reshape(-1, 2)
    near = (_states(cells, ends[:, None] + shifts) == OCCUPIED).any(axis=1)
    known = near | (_states(cells, ends) != UNKNOWN)
    # Places along each beam, one in a cell's length, that end before its own obstacle begins.
    ranges = beams.ranges[at].astype(np.float64)
    steps = np.arange(reach, max(ranges.max() / cells.resolution - 2 * reach, reach)) * cells.resolution
    start = np.array(sensor.position)
    along = start + (steps / ranges[:, None])[..., None] * (ends - start)[:, None]
    before = steps < ranges[:, None] - 2 * reach * cells.resolution
    through = ((_states(cells, along) == OCCUPIED) & before).any(axis=1)
    judged = known | through
    if np.count_nonzero(judged) < min(_FEWEST, len(ends)):
        return None
    return float(np.count_nonzero(near & ~through) / np.count_nonzero(judged))


def _states(cells: MeasuredGrid, points: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return the states of the cells that hold points, shape (..., 2), metres; unknown beyond the grid."""
    numbers = np.floor((points - np.array(cells.origin)) / cells.resolution).astype(np.int64)
    rows, columns = cells.states.shape
    inside = (numbers >= 0).all(axis=-1) & (numbers < (columns, rows)).all(axis=-1)
    states = np.full(points.shape[:-1], UNKNOWN, dtype=np.int8)
    states[inside] = cells.states[numbers[inside][:, 1], numbers[inside][:, 0]]
    return states
