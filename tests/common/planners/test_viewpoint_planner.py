from __future__ import annotations

import numpy as np
import pytest

from common.errors import ConfigError
from common.geometry import Pose
from common.planners.base import Status
from common.planners.exploration.greedy import GreedyPlanner
from common.planners.exploration.nearest import NearestPlanner
from common.planners.viewpoint_planner import ScannedViewpoints, lead_to
from common.planners.visibility import observed
from tests.common.planners.rollout import drawn
from tests.common.planners.worlds import ARMS, CONFIG, DEAD_END, looked

# A short arm with little to see on the left, a wide hall behind the door on the right.
HALL = drawn(
    [
        "##############",
        "######.......#",
        "#....S.......#",
        "######.......#",
        "##############",
    ]
)


def test_greedy_prefers_what_shows_more() -> None:
    mapper, pose = looked(HALL)
    plan = GreedyPlanner(CONFIG).plan(mapper, pose)
    assert plan.beacon is not None
    assert plan.beacon[0] > pose.x


def test_greedy_scale_weighs_the_way() -> None:
    mapper, pose = looked(ARMS)
    utility = mapper.observe().utility
    distances = mapper.distances(mapper.robot)
    others = (utility > 0) & (distances > 0.0)
    for scale in (1.0, 1e6):
        plan = GreedyPlanner(CONFIG, scale=scale, cover_range=10.0, min_frontier=0.1).plan(mapper, pose)
        goal = next(n for n in range(len(utility)) if mapper.position(n) == plan.beacon)
        value = np.where(others, np.log(np.maximum(utility, 1)) - distances / scale, -np.inf)
        assert value[goal] == pytest.approx(value.max())


def test_greedy_leaves_small_frontiers_until_nothing_larger_is_left() -> None:
    mapper, pose = looked(ARMS, [(14.0, 14.0)])

    def beacon(min_frontier: float) -> tuple[tuple[float, float], float]:
        """The beacon and the metres of frontier that it observes; the way counts so much that the nearest wins."""
        made = GreedyPlanner(CONFIG, scale=1.0, cover_range=8.0, min_frontier=min_frontier)
        place = made.plan(mapper, pose).beacon
        assert place is not None
        seen = observed(mapper.belief, np.array([place]), mapper.frontiers, 8.0).sum() * CONFIG.resolution
        return place, float(seen)

    near, seen = beacon(0.1)
    far, more = beacon(seen + 0.1)
    assert far != near
    assert more > seen
    assert beacon(1e3) == (near, seen)


@pytest.mark.parametrize("setting", ["scale", "cover_range", "min_frontier"])
def test_greedy_refuses_settings_of_zero(setting: str) -> None:
    with pytest.raises(ConfigError, match=setting):
        GreedyPlanner(CONFIG, **{setting: 0.0})


def test_nearest_goes_to_the_nearer_frontier() -> None:
    # From the middle of the corridor both ends are hidden; the robot was further to the left before.
    mapper, pose = looked(DEAD_END)
    plan = NearestPlanner(CONFIG).plan(mapper, pose)
    frontiers = mapper.frontiers
    assert plan.beacon is not None
    nearest = frontiers[np.argmin(np.hypot(*(frontiers - pose.position).T))]
    assert np.hypot(*(nearest - plan.beacon)) <= np.hypot(*(nearest - pose.position))


@pytest.mark.parametrize("planner", [NearestPlanner(CONFIG), GreedyPlanner(CONFIG)], ids=["nearest", "greedy"])
def test_robot_that_cannot_move_is_told_the_end(planner: NearestPlanner | GreedyPlanner) -> None:
    mapper, pose = looked(ARMS)
    planner.reset("exploration", None, 0)
    for _ in range(200):
        plan = planner.plan(mapper, pose)
        if plan.status is Status.COMPLETE:
            return
    pytest.fail("the planner sends a robot that never moves to the same places forever")


def test_scanned_viewpoints_are_remembered_by_place() -> None:
    mapper, pose = looked(ARMS)
    scanned = ScannedViewpoints(CONFIG.viewpoint_spacing)
    useful = np.flatnonzero(mapper.observe().utility)
    assert mapper.robot in useful
    scanned.note(mapper, Pose(pose.x + 1.5, pose.y))
    assert scanned.candidates(mapper).tolist() == useful.tolist()
    scanned.note(mapper, Pose(pose.x + 0.5, pose.y))
    assert scanned.candidates(mapper).tolist() == [node for node in useful.tolist() if node != mapper.robot]


def test_lead_to_its_own_viewpoint() -> None:
    x, y = ARMS.start
    mapper, pose = looked(ARMS, [(x + 1.0, y)])
    plan = lead_to(mapper, pose, [mapper.robot], CONFIG.viewpoint_spacing)
    assert plan.waypoint == pytest.approx(ARMS.start)
    there = lead_to(mapper, Pose(x, y), [mapper.robot], CONFIG.viewpoint_spacing)
    assert there.status is Status.COMPLETE
