"""Occupancy from noisy scans: log-odds with thresholds and hysteresis (Moravec and Elfes, 1985; OctoMap, 2013)."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite, log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.belief import RANGE_TOLERANCE
from common.mapping.raycast import (
    FARTHEST,
    SUBCELL_BITS,
    SUBCELLS,
    cell_behind_border,
    enter_next_cell,
    ray_axis,
    ray_units,
    to_subcells,
)
from common.mapping.sight import FREE, OCCUPIED
from common.system.jit import njit
from deploy.config import SensingConfig
from deploy.mapping.measured_grid import MeasuredGrid

# Beams that end so many standard deviations of the range noise behind a cell speak against a hit in it.
GRAZE_DEVIATIONS: Final = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """What a sensor saw in the plane, from one place.

    Beam ``i`` points at ``pose.yaw + angles[i]``.

    Attributes:
        ranges: metres, float32, shape (beams,); NaN where a beam tells nothing.
        hits: whether an obstacle is at the end, bool, same shape; without one the beam is free up to its end.
        angles: radians, float64, same shape.
    """

    ranges: NDArray[np.float32]
    hits: NDArray[np.bool_]
    angles: NDArray[np.float64]

    @classmethod
    def from_scan(cls, scan: Scan, range_min: float, range_max: float) -> Beams:
        """Cut a scan to a sensor's limits.

        Readings below ``range_min`` tell nothing; those at or above ``range_max`` or the scan's own one (infinite ones
        too) are free up to there.
        """
        limit = min(range_max, scan.range_max)
        ranges = np.asarray(scan.ranges, dtype=np.float32)
        hits = ranges < limit - RANGE_TOLERANCE
        ranges = np.where(hits, ranges, np.float32(limit))
        told = scan.ranges >= max(range_min, scan.range_min, 0.0)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges), dtype=np.float64)
        return cls(np.where(told, ranges, np.float32(np.nan)), hits & told, angles)

    def ends(self, pose: Pose) -> NDArray[np.float64]:
        """Return where the beams met obstacles when the sensor stood at a pose, map frame, metres, shape (n, 2)."""
        at = np.flatnonzero(self.hits)
        angles = pose.yaw + self.angles[at]
        ranges = self.ranges[at].astype(np.float64)
        return np.stack([pose.x + ranges * np.cos(angles), pose.y + ranges * np.sin(angles)], axis=1)


@njit(cache=True, nogil=True)
def _trace(
    passed: NDArray[np.int16],
    ended: NDArray[np.int16],
    width: int,
    start_x: float,
    start_y: float,
    ranges: NDArray[np.float32],
    hits: NDArray[np.bool_],
    angles: NDArray[np.float64],
    resolution: float,
    noise: float,
) -> None:
    """Count per cell of a window the beams that speak for free and those that ended in it.

    The traversal is that of `common.mapping.raycast`. An end within one standard deviation before a border counts as
    that of the cell behind the border. `passed` is 0 where no beam passed, else 1 plus the number of beams that ended
    within `GRAZE_DEVIATIONS` behind the cell; without noise a hit always counts.
    """
    start = int(np.floor(start_y)) * width + int(np.floor(start_x))
    for beam in range(len(ranges)):
        reach = np.float64(ranges[beam])
        if not reach >= 0.0:
            continue
        hit = hits[beam]
        stop = ray_units((reach - RANGE_TOLERANCE) / resolution)
        exact_end = ray_units((reach + RANGE_TOLERANCE) / resolution)
        end = ray_units((reach + max(noise, RANGE_TOLERANCE)) / resolution)
        graze = ray_units((reach - GRAZE_DEVIATIONS * noise) / resolution)
        angle = angles[beam]
        step_x, next_x, delta_x = ray_axis(start_x, np.cos(angle))
        step_y, next_y, delta_y = ray_axis(start_y, np.sin(angle))
        step_y *= width
        index = start
        ahead = min(next_x, next_y)
        while ahead < stop:
            passed[index] = max(passed[index], 1) + (hit and noise > 0.0 and ahead >= graze)
            index, next_x, next_y = enter_next_cell(index, step_x, step_y, next_x, next_y, delta_x, delta_y)
            ahead = min(next_x, next_y)
        if not hit:
            passed[index] = max(passed[index], 1)
        elif ahead > end:
            ended[index] += 1
        else:
            # The beam ended at a border and met the cell behind it; at a corner it does not tell which.
            passed[index] = max(passed[index], 1) + (noise > 0.0)
            met = cell_behind_border(index, step_x, step_y, next_x, next_y, delta_x, delta_y, exact_end)
            if met >= 0:
                ended[met] += 1


@njit(cache=True, nogil=True)
def _apply(
    log_odds: NDArray[np.float32],
    states: NDArray[np.int8],
    passed: NDArray[np.int16],
    ended: NDArray[np.int16],
    top: int,
    left: int,
    hit: float,
    miss: float,
    low: float,
    high: float,
    free_below: float,
    occupied_above: float,
) -> tuple[int, int, int, int]:
    """Add a scan's evidence, once per cell, and return the box of cells whose state changed (last row -1: none).

    A cell in which a beam ended is a hit, unless more beams ended just behind it: then it is the noise of that wall.
    """
    row_low, row_high, column_low, column_high = 1 << 40, -1, 1 << 40, -1
    rows, columns = passed.shape
    for i in range(rows):
        for j in range(columns):
            behind = passed[i, j]
            count = ended[i, j]
            if behind == 0 and count == 0:
                continue
            row, column = top + i, left + j
            odds = log_odds[row, column]
            odds += hit if count > 0 and count >= behind - 1 else miss
            odds = min(max(odds, low), high)
            log_odds[row, column] = odds
            state = states[row, column]
            if odds > occupied_above:
                state = OCCUPIED
            elif odds < free_below:
                state = FREE
            if state != states[row, column]:
                states[row, column] = state
                row_low, row_high = min(row_low, row), max(row_high, row)
                column_low, column_high = min(column_low, column), max(column_high, column)
    return row_low, row_high, column_low, column_high


class LogOddsGrid(MeasuredGrid):
    """A grid whose cells remember how probable an obstacle is, and can change their mind.

    Each scan counts once per cell, as a hit or as a miss, however many beams met it. Probabilities are clamped, so that
    about ten scans past a place from which a person walked away free it again. A state changes only beyond the
    thresholds; between them the cell keeps what it was.
    """

    def __init__(self, resolution: float, anchor: tuple[float, float], config: SensingConfig) -> None:
        super().__init__(resolution, anchor)
        self._log_odds: NDArray[np.float32] = np.empty((0, 0), dtype=np.float32)
        self._noise = config.range_noise
        low, high = (_log_odds_of(limit) for limit in config.probability_limits)
        self._evidence = (
            _log_odds_of(config.probability_hit),
            _log_odds_of(config.probability_miss),
            low,
            high,
            _log_odds_of(config.free_below),
            _log_odds_of(config.occupied_above),
        )

    def integrate(self, beams: Beams, pose: Pose) -> None:
        """Add what a sensor saw from a pose of its own in the map frame.

        Raises:
            MappingError: a number of the pose or of the beams' geometry is not finite, or the map grows beyond reason.
        """
        if not all(isfinite(number) for number in (pose.x, pose.y, pose.yaw)) or not np.isfinite(beams.angles).all():
            bad = np.count_nonzero(~np.isfinite(beams.angles))
            raise MappingError(
                f"beams need a finite pose and finite angles, got {pose} and {bad} angles that are not: drop this scan"
            )
        told = np.isfinite(beams.ranges)
        if not told.any():
            return
        if max(abs(pose.x - self.anchor[0]), abs(pose.y - self.anchor[1])) > FARTHEST * self.resolution:
            raise MappingError(f"the pose {pose} is too far from the map at {self.anchor}: check the localisation")
        reach = ceil((float(beams.ranges[told].max()) + self._noise) / self.resolution) + 2
        x = to_subcells(pose.x, self.anchor[0], self.resolution)
        y = to_subcells(pose.y, self.anchor[1], self.resolution)
        row, column = (y >> SUBCELL_BITS) - reach, (x >> SUBCELL_BITS) - reach
        side = 2 * reach + 1
        self.cover(row, row + side, column, column + side)
        passed = np.zeros((side, side), dtype=np.int16)
        ended = np.zeros((side, side), dtype=np.int16)
        _trace(
            passed.reshape(-1),
            ended.reshape(-1),
            side,
            x / SUBCELLS - column,
            y / SUBCELLS - row,
            beams.ranges,
            beams.hits,
            pose.yaw + beams.angles,
            self.resolution,
            self._noise,
        )
        top, left = row - self._first[0], column - self._first[1]
        box = _apply(self._log_odds, self.states, passed, ended, top, left, *self._evidence)
        if box[1] >= 0:
            self.note(box)

    def _move(self, before: tuple[int, int, int, int] | None) -> None:
        log_odds = np.zeros(self._shape, dtype=np.float32)
        if before is not None:
            top, bottom, left, right = before
            log_odds[top:bottom, left:right] = self._log_odds
        self._log_odds = log_odds
        super()._move(before)


def _log_odds_of(probability: float) -> float:
    return log(probability / (1.0 - probability))
