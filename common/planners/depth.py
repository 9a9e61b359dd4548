"""Whether a world is of the kind that a policy was trained in: the guard of the learned planner."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED

# The world is judged as soon as so much is known, as a share of the disc that the sensor reaches: 250 m2 at 20 m.
JUDGED_AT: Final = 0.2
# On the block maps of the policy's training a lattice square of known floor holds at most so many viewpoints; where
# furniture, winding walls or trees divide the floor, it holds more. And a decision shows so much of the disc, at least.
MOST_VIEWPOINTS: Final = 1.05
LEAST_SHOWN: Final = 0.2
# In the open a decision shows much of the disc, and the known floor has a long frontier: the share of the disc, and
# `FRONTIER_WEIGHT` times the frontier by the side of a square as large.
OPEN: Final = 0.66
FRONTIER_WEIGHT: Final = 0.03
# Among trees the frontier is longer than in halls and tunnels, for every trunk hides something, and few occupied cells
# lie in a row, as those of walls and shelves do: the share of the disc, this much of the frontier, less their share.
AMONG_TREES: Final = 0.5
FRONTIER_AMONG_TREES: Final = 0.05
# More decisions of the rule against cycles than this in an episode: the policy dithers.
MOST_CYCLES: Final = 8


class Decider(Enum):
    """Who decides: the policy, or the classical planner for worlds of this kind (see `Task`)."""

    POLICY = "policy"
    REFERENCE = "reference"
    IN_THE_OPEN = "in_the_open"


class Depth:
    """Judges whether a policy trained on block maps is in its depth; once it is not, it is not for all the episode.

    Measured on 290 worlds of validation seeds when a fifth of the disc was known: viewpoints a square 0.81 to 1.01 on
    public maps and in rooms, where a decision shows 0.23 of the disc or more; 1.16 and more in forests, offices,
    warehouses, tunnels and buildings. Over whole explorations of 40 public maps and rooms they never rise above 1.005.
    Of 220 forests 188 count as such, of 290 offices, warehouses and tunnels none, with 360 and with 720 beams.
    In forests the policy explores with as much travel as the best classical planner, or less. In halls, which are as
    open, it dithers.

    Args:
        config: the mapping of the episode.
        known_scale: whether cells, spacing and sensor are near those of the policy's training; otherwise it is never in
            its depth.
        same_spacing: whether the spacing is just that of the training. With another one, block maps hold as many
            viewpoints a square as forests, and the policy decides wherever it is open.
        explores: whether the task is exploration, in which the policy masters forests; in navigation D* Lite does.
    """

    def __init__(
        self, config: MappingConfig, *, known_scale: bool = True, same_spacing: bool = True, explores: bool = True
    ) -> None:
        self._square = config.viewpoint_spacing**2
        self._disc = math.pi * config.sensor_range**2
        self._resolution = config.resolution
        self._same_spacing = same_spacing
        self._explores = explores
        self._decisions = 0
        self._open = self._mastered = False
        self._judged = self._out_of_depth = not known_scale

    def decider(self, mapper: Mapper, cycles: int) -> Decider:
        """Return who shall decide; to be asked once for each decision. The reference until the world can be judged.

        Args:
            mapper: updated, and not stuck.
            cycles: decisions of the rule against cycles so far.
        """
        self._decisions += 1
        area = mapper.explored_area
        if area < JUDGED_AT * self._disc:
            return Decider.REFERENCE
        if not self._judged:
            self._judged = True
            shown = area / self._decisions / self._disc
            frontier = len(mapper.frontiers) * self._resolution / math.sqrt(area)
            in_a_row = share_in_a_row(mapper.belief.cells == OCCUPIED)
            among_trees = shown + FRONTIER_AMONG_TREES * frontier - in_a_row >= AMONG_TREES
            self._open = among_trees or shown + FRONTIER_WEIGHT * frontier >= OPEN
            self._mastered = self._explores and (among_trees or (self._open and not self._same_spacing))
            self._out_of_depth = shown < LEAST_SHOWN
        whole = len(mapper.viewpoints) * self._square <= MOST_VIEWPOINTS * area
        familiar = whole or self._mastered
        self._out_of_depth = self._out_of_depth or not familiar or cycles > MOST_CYCLES
        if not self._out_of_depth:
            return Decider.POLICY
        return Decider.IN_THE_OPEN if self._open else Decider.REFERENCE


def share_in_a_row(occupied: NDArray[np.bool_]) -> float:
    """Return the share of the occupied cells that lie between two others along an axis of the grid; 0 without any.

    Args:
        occupied: shape (h, w).
    """
    row = np.zeros_like(occupied)
    row[1:-1] = occupied[:-2] & occupied[1:-1] & occupied[2:]
    row[:, 1:-1] |= occupied[:, :-2] & occupied[:, 1:-1] & occupied[:, 2:]
    count = int(np.count_nonzero(occupied))
    return int(np.count_nonzero(row)) / count if count else 0.0
