"""What TARE counts as worth a visit, near and far."""

from __future__ import annotations

import pytest

from common.errors import ConfigError
from common.planners.registry import make_planner
from tests.common.planners.rollout import drawn
from tests.common.planners.worlds import CONFIG, looked

pytest.importorskip("ortools")

# A narrow side way next to the start, and a wide hall at the far end of the corridor.
HALL = drawn(
    [
        "####################",
        "##.######.........##",
        "##.######.........##",
        "##.######.........##",
        "#.S...............##",
        "#########.........##",
        "#########.........##",
        "#########.........##",
        "####################",
    ]
)


def _way_to_beacon(patience: float, detour: float = 0.0) -> float:
    x, y = HALL.start
    steps = [*range(0, 33, 4), *range(28, -1, -4)]
    mapper, pose = looked(HALL, [(x + step, y) for step in steps])
    planner = make_planner("tare", CONFIG, min_frontier=8.0, min_doorway=2.0, patience=patience, detour=detour)
    beacon = planner.plan(mapper, pose).beacon
    assert beacon is not None
    return pose.distance_to(beacon)


def test_small_remainders_wait_while_more_is_near_but_not_before_a_long_way() -> None:
    assert _way_to_beacon(patience=1000.0) > 16.0
    assert _way_to_beacon(patience=16.0) < 16.0


def test_small_remainders_are_taken_along_where_they_lie_on_the_way() -> None:
    # One step into the side way and back is 8 m, and some less by the diagonals.
    assert _way_to_beacon(patience=1000.0, detour=1.0) > 16.0
    assert _way_to_beacon(patience=1000.0, detour=9.0) < 16.0


def test_a_negative_detour_is_refused() -> None:
    with pytest.raises(ConfigError, match="detour"):
        make_planner("tare", CONFIG, detour=-1.0)


@pytest.mark.parametrize("setting", ["min_frontier", "min_doorway", "patience"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_settings_that_do_not_work_are_refused(setting: str, value: float) -> None:
    with pytest.raises(ConfigError, match=setting):
        make_planner("tare", CONFIG, **{setting: value})
