"""Whether a goal is still worth going to."""

from __future__ import annotations

from typing import Final

import numpy as np

from common.mapping.mapper import Mapper
from common.planners.base import Position

# A viewpoint moves when what is known of its surroundings changes; within this share of the spacing it is the same.
_SAME_VIEWPOINT: Final = 0.25


def nothing_to_see(mapper: Mapper, goal: Position, spacing: float) -> bool:
    """Whether the viewpoint at a place, metres, observes no frontier any more; False for places that are none."""
    if mapper.stuck:
        return False
    gaps = np.hypot(*(mapper.viewpoints - np.array(goal)).T)
    node = int(gaps.argmin())
    return bool(gaps[node] < _SAME_VIEWPOINT * spacing and mapper.observe().utility[node] == 0)
