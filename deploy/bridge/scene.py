"""What the planner sees, as JSON for pages and other programs: the markers' content with the numbers behind it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.planners.base import Planner, Position
from common.planners.learned import LearnedPlanner
from deploy.bridge.drawing import edge_segments, thinned_frontiers
from deploy.bridge.outcome import Outcome
from deploy.ros2 import Message, message

VERSION: Final = 1
_MAX_VIEWPOINTS: Final = 4000
_MAX_CHOICES: Final = 500
# Kinds of viewpoints.
_PLAIN: Final = 0
_VISITED: Final = 1
_USEFUL: Final = 2


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
        "frontiers": _centimetres(thinned_frontiers(mapper)),
        "banned": _centimetres(outcome.bans),
    }
    if not mapper.stuck:
        observation = mapper.observe()
        kinds = np.where(observation.utility > 0, _USEFUL, np.where(observation.visited, _VISITED, _PLAIN))
        viewpoints = mapper.viewpoints
        count = min(len(viewpoints), len(kinds), _MAX_VIEWPOINTS)
        placed = np.column_stack([np.rint(100.0 * viewpoints[:count]), kinds[:count]])
        found["viewpoints"] = placed.astype(np.int64).ravel().tolist()
        found["edges"] = _centimetres(edge_segments(mapper))
        found["beacons"] = _choices(mapper.beacons, None)
    attention = planner.attention if isinstance(planner, LearnedPlanner) else None
    if attention is not None and outcome.course is not None:
        found["beacons"] = _choices(attention.beacons, attention.beacon_probabilities)
        found["waypoints"] = _choices(attention.waypoints, attention.waypoint_probabilities)
    return message("std_msgs/msg/String", data=json.dumps(found, separators=(",", ":")))


def _centimetres(positions: Iterable[Position] | NDArray[np.float64]) -> list[int]:
    array = np.asarray(positions if isinstance(positions, np.ndarray) else list(positions), dtype=np.float64)
    flat: list[int] = np.rint(100.0 * array).astype(np.int64).ravel().tolist()
    return flat


def _choices(positions: NDArray[np.float64], probabilities: NDArray[np.float32] | None) -> list[int]:
    placed = np.asarray(positions, np.float64).reshape(-1, 2)
    shares = np.full(len(placed), -0.001) if probabilities is None else np.asarray(probabilities, np.float64)
    if len(placed) > _MAX_CHOICES:
        keep = np.argsort(-shares, kind="stable")[:_MAX_CHOICES]
        placed, shares = placed[keep], shares[keep]
    flat: list[int] = np.rint(np.column_stack([100.0 * placed, 1000.0 * shares])).astype(np.int64).ravel().tolist()
    return flat
