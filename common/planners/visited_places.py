"""Where a robot has been since it last learned something, so that planners notice when they go in circles."""

from __future__ import annotations

from math import hypot, inf
from typing import Final

from common.mapping.mapper import Mapper
from common.planners.base import Position

# New area that counts as a gain, square metres: less is what scans graze in passing, and noisy ranges make single cells
# known at almost every step.
GAIN_AREA: Final = 0.5
# Positions of one viewpoint may differ so much between updates, metres.
_SAME: Final = 1e-3


class PlacesSinceGain:
    """The viewpoints at which a planner has decided since the belief last grew by `GAIN_AREA`."""

    def __init__(self, reach: float = 0.0) -> None:
        """Know of none; places nearer to each other than `reach`, metres, count as one."""
        self._reach = max(reach, _SAME)
        self._area = -inf
        self._places: set[Position] = set()

    def __contains__(self, position: Position) -> bool:
        return any(hypot(position[0] - x, position[1] - y) <= self._reach for x, y in self._places)

    def add(self, position: Position) -> None:
        """Note a viewpoint at which the planner decides."""
        self._places.add(position)

    def forget_on_gain(self, mapper: Mapper) -> bool:
        """Forget all viewpoints when the belief has grown enough since the last gain; return whether it has."""
        area = mapper.belief.known_cells * mapper.belief.resolution**2
        gained = area >= self._area + GAIN_AREA
        if gained:
            self._area = area
            self._places.clear()
        return gained
