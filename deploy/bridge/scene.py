"""What the planner sees, as JSON for pages and other programs: the markers' content with the numbers behind it."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.messages.places import centimetres, viewpoint_kinds
from common.planners.base import Planner
from common.planners.learned import LearnedPlanner
from deploy.bridge.drawing import edge_segments, thinned_frontiers
from deploy.bridge.outcome import Outcome
from deploy.ros2 import Message, message

VERSION: Final = 1
_MAX_VIEWPOINTS: Final = 4000
_MAX_CHOICES: Final = 500


def scene(outcome: Outcome, planner: Planner) -> Message | None:
    """Build the message; None while there is no map.

    Positions are centimetres in the map frame, flat lists of integers: `viewpoints` (x, y, kind, ...) with kind 0
    plain, 1 visited, 2 useful, `edges` (x, y, x, y, ...), `frontiers` (x, y, ...) of cells of `cell` centimetres,
    `banned` (x, y, ...). `beacons` and `waypoints` are (x, y, probability, ...), where the probability is in
    thousandths, or -1 with a planner that has none. All are bounded, as the markers are.

    Args:
        outcome: of this pass of the decision loop; its mapper is read.
        planner: in charge; a learned one tells the probabilities of its choices.
    """
    mapper = outcome.mapper
    if mapper is None:
        return None
    found: dict[str, Any] = {
        "version": VERSION,
        "cell": round(100.0 * mapper.belief.resolution),
        "frontiers": centimetres(thinned_frontiers(mapper)),
        "banned": centimetres(outcome.bans),
    }
    if not mapper.stuck:
        viewpoints, kinds = mapper.viewpoints, viewpoint_kinds(mapper.observe())
        count = min(len(viewpoints), len(kinds), _MAX_VIEWPOINTS)
        found["viewpoints"] = centimetres(viewpoints[:count], kinds[:count])
        found["edges"] = centimetres(edge_segments(mapper))
        found["beacons"] = _choices(mapper.beacons, None)
    attention = planner.attention if isinstance(planner, LearnedPlanner) else None
    if attention is not None and outcome.course is not None:
        found["beacons"] = _choices(attention.beacons, attention.beacon_probabilities)
        found["waypoints"] = _choices(attention.waypoints, attention.waypoint_probabilities)
    return message("std_msgs/msg/String", data=json.dumps(found, separators=(",", ":")))


def _choices(positions: NDArray[np.float64], probabilities: NDArray[np.float32] | None) -> list[int]:
    placed = np.asarray(positions, np.float64).reshape(-1, 2)
    shares = np.full(len(placed), -0.001) if probabilities is None else np.asarray(probabilities, np.float64)
    if len(placed) > _MAX_CHOICES:
        keep = np.argsort(-shares, kind="stable")[:_MAX_CHOICES]
        placed, shares = placed[keep], shares[keep]
    return centimetres(placed, 1000.0 * shares)
