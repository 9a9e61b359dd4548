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
from common.planners.exploration.clusters import cluster_labels, openings

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
# Among trees few occupied cells lie in a line, as those of walls, shelves and counters do: fewer than this share.
# The frontier is longer than in tunnels, for every trunk hides something, and less stands in the way: the share of the
# disc, this much of the frontier, less so much of the metres of occupied cells on a square metre of known floor.
LEAST_IN_LINE: Final = 0.65
AMONG_TREES: Final = 0.25
FRONTIER_AMONG_TREES: Final = 0.05
OCCUPIED_AMONG_TREES: Final = 4.0
# A longer sensor than in training wants viewpoints farther apart, and then block maps hold more of them, too. There so
# many metres of occupied cells stand on a square metre of known floor, at most, it has so many openings on 100 m2, and
# its frontier is so long by the side of a square as large. In halls there are more openings, and longer frontiers.
MOST_OCCUPIED: Final = 0.22
MOST_OPENINGS: Final = 1.0
MOST_FRONTIER: Final = 4.0
# More decisions of the rule against cycles than this in an episode: the policy dithers.
MOST_CYCLES: Final = 8
# A cell lies in a line with at least `IN_LINE` of the cells up to `LINE` before and behind it, itself included.
LINE: Final = 4
IN_LINE: Final = 4


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
    In forests the policy explores with as much travel as the best classical planner, or less. In halls, which are as
    open, it dithers; docs/experiments.md tells how many worlds of each kind are taken for which.

    Args:
        config: the mapping of the episode.
        known_scale: whether cells, spacing and sensor are near those of the policy's training; otherwise it is never in
            its depth.
        trained: the mapping of the policy's training; that of the episode when not given. With viewpoints at another
            spacing block maps hold as many a square as forests: with closer ones the policy decides wherever it is
            open, with a longer sensor wherever walls alone divide the floor.
        explores: whether the task is exploration, in which the policy masters forests; in navigation it does not.
    """

    def __init__(
        self,
        config: MappingConfig,
        *,
        known_scale: bool = True,
        trained: MappingConfig | None = None,
        explores: bool = True,
    ) -> None:
        self._square = config.viewpoint_spacing**2
        self._disc = math.pi * config.sensor_range**2
        self._resolution = config.resolution
        trained = trained or config
        self._closer = config.viewpoint_spacing < trained.viewpoint_spacing
        self._sees_farther = config.sensor_range > trained.sensor_range
        self._explores = explores
        self._decisions = 0
        self._among_trees = self._mastered = self._walls_alone = False
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
            self._judge(mapper, area)
        whole = len(mapper.viewpoints) * self._square <= MOST_VIEWPOINTS * area
        familiar = whole or self._mastered or (self._walls_alone and self._occupied(mapper, area) <= MOST_OCCUPIED)
        self._out_of_depth = self._out_of_depth or not familiar or cycles > MOST_CYCLES
        if not self._out_of_depth:
            return Decider.POLICY
        return Decider.IN_THE_OPEN if self._among_trees else Decider.REFERENCE

    def _judge(self, mapper: Mapper, area: float) -> None:
        """Note of which kind the world is."""
        shown = area / self._decisions / self._disc
        frontier = len(mapper.frontiers) * self._resolution / math.sqrt(area)
        in_line = share_in_line(mapper.belief.cells == OCCUPIED)
        trees = shown + FRONTIER_AMONG_TREES * frontier - OCCUPIED_AMONG_TREES * self._occupied(mapper, area)
        is_open = shown + FRONTIER_WEIGHT * frontier >= OPEN
        self._among_trees = in_line < LEAST_IN_LINE and (is_open or trees >= AMONG_TREES)
        self._mastered = self._explores and (self._among_trees or (is_open and self._closer))
        if self._sees_farther:
            clusters = np.bincount(cluster_labels(*mapper.frontier_cells))
            closed = openings(clusters, self._resolution, area) <= MOST_OPENINGS and frontier <= MOST_FRONTIER
            self._walls_alone = closed and in_line >= LEAST_IN_LINE
        self._out_of_depth = shown < LEAST_SHOWN and not self._walls_alone

    def _occupied(self, mapper: Mapper, area: float) -> float:
        """Return metres of occupied cells on a square metre of known floor."""
        return int(np.count_nonzero(mapper.belief.cells == OCCUPIED)) * self._resolution / area


def share_in_line(occupied: NDArray[np.bool_]) -> float:
    """Return the share of the occupied cells that lie in a line with others along an axis of the grid; 0 without any.

    A line has gaps where the beams of a lidar fall wider apart than the cells: of the nine cells from four before to
    four behind one, four have to be occupied.

    Args:
        occupied: shape (h, w).
    """
    count = int(np.count_nonzero(occupied))
    if not count:
        return 0.0
    cells = np.pad(occupied, LINE).view(np.uint8)
    height, width = occupied.shape
    up = sum(cells[k : k + height, LINE : LINE + width] for k in range(2 * LINE + 1))
    across = sum(cells[LINE : LINE + height, k : k + width] for k in range(2 * LINE + 1))
    return int(np.count_nonzero(occupied & (np.maximum(up, across) >= IN_LINE))) / count
