"""Ways over the cells of the map, and detours around what is banned."""

from itertools import pairwise

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.config.schema import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Status
from deploy.bridge.cell_route import to_frontier, to_target
from deploy.bridge.detour import detour, nearest_free_place
from deploy.bridge.diagnosis import Cause, diagnose
from deploy.bridge.mission import Phase
from tests.common.planners.worlds import ARMS, CONFIG, ROOMS, looked
from tests.deploy.bridge.offline import Trial, ended, settings


def narrow(door: float) -> GridMap:
    """Two rooms of 8 m x 8 m, 0.25 m cells, with a door between two columns of a lattice of 2 m."""
    free = np.zeros((34, 70), dtype=bool)
    free[1:33, 1:33] = free[1:33, 37:69] = True
    width = round(door / 0.25)
    free[17 : 17 + width, 33:37] = True
    return GridMap("narrow", free, 0.25, (0.0, 0.0), (2.0, 2.0), None, None, (1.0, 1.0))


def narrow_trial(**sections):
    mapping = {"resolution": 0.25, "sensor_range": 10.0, "viewpoint_spacing": 2.0, "beacon_range": 10.0}
    trial = Trial(narrow(0.75), settings(mapping=mapping, **sections))
    trial.mission.start()
    return trial


def test_a_door_between_two_columns_of_the_lattice_is_driven_through():
    trial = narrow_trial()
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert max(o.pose.x for o in trial.outcomes) > 9.0
    assert any(o.course and "no viewpoint leads there" in o.course.reason for o in trial.outcomes)
    assert last.mapper.explored_area > 120.0
    for outcome in trial.outcomes:
        if outcome.course and outcome.decided:
            assert trial.simulator._world.is_free(outcome.course.waypoint)


def test_a_target_behind_such_a_door_is_reached():
    trial = narrow_trial(decision={"task": "navigation", "planner": "astar", "goal": [14.0, 2.0]})
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED, last.orders.reason
    assert trial.pose.distance_to((14.0, 2.0)) <= 0.8


def test_a_door_that_is_left_alone_for_a_while_is_waited_for_and_no_end():
    """Bans pass; an exploration that took a banned door for a wall ended with half of a building unseen."""
    trial = narrow_trial(safety={"blacklist_time": 20.0})
    before = trial.run(200, lambda o: bool(o.course) and "no viewpoint leads there" in o.course.reason)
    assert before.mapper.explored_area < 110.0
    trial.loop.report_blocked("somebody stands in the door")
    held = trial.run(15, lambda o: "tries again" in o.hold)
    assert held.bans
    assert "somebody stands in the door" in held.hold
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.mapper.explored_area > 120.0


def test_a_way_over_cells_keeps_out_of_closed_discs():
    mapper, pose = looked(ROOMS)
    plan = to_frontier(mapper, pose, 4.0, lambda where: False)
    other = to_frontier(mapper, pose, 4.0, lambda where: False, [(plan.waypoint, 1.0)])
    assert other.status is Status.GOING
    for place in (other.waypoint, *other.path):
        assert np.hypot(place[0] - plan.waypoint[0], place[1] - plan.waypoint[1]) > 1.0
    around = [((pose.x + 4.0 * np.cos(turn), pose.y + 4.0 * np.sin(turn)), 1.0) for turn in np.arange(0.0, 6.28, 0.3)]
    assert to_frontier(mapper, pose, 4.0, lambda where: False, around).status is Status.COMPLETE
    here = to_frontier(mapper, pose, 4.0, lambda where: False, [(pose.position, 1.0)])
    assert here.waypoint == plan.waypoint, "a robot in a closed disc may leave it"


def test_home_is_found_through_such_a_door():
    trial = narrow_trial(decision={"return_home": True})
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.pose.distance_to((2.0, 2.0)) <= 0.8


def test_a_frontier_is_approached_in_straight_free_legs():
    mapper, pose = looked(ROOMS)
    plan = to_frontier(mapper, pose, 4.0, lambda where: False)
    assert plan.status is Status.GOING
    places = [pose.position, plan.waypoint, *plan.path]
    for a, b in pairwise(places):
        assert mapper.segment_free(a, b)
    assert np.hypot(*(mapper.frontiers - np.array(plan.beacon)).T).min() < 1.0
    assert to_frontier(mapper, pose, 4.0, lambda where: True).status is Status.COMPLETE


@pytest.mark.parametrize("target", [(6.0, 14.0), (200.0, 14.0)])
def test_a_target_in_the_unknown_is_approached_as_far_as_the_map_goes(target):
    mapper, pose = looked(ARMS)
    plan = to_target(mapper, pose, target, 4.0)
    assert plan.status is Status.GOING
    assert (plan.waypoint[0] < pose.x) == (target[0] < pose.x)
    assert mapper.belief.at(plan.beacon) == 0


def test_a_detour_avoids_what_is_banned():
    mapper, pose = looked(ROOMS)
    free = detour(mapper, pose, None, lambda where: True)
    assert free.status is Status.GOING
    around = detour(mapper, pose, None, lambda where: where != free.waypoint)
    assert around.waypoint != free.waypoint
    assert free.waypoint not in around.path
    assert detour(mapper, pose, None, lambda where: False).status is Status.UNREACHABLE


def test_the_nearest_free_place_of_a_robot_in_a_wall():
    mapper, pose = looked(ROOMS)
    wall = Pose(pose.x, 3.9)
    mapper.update(wall)
    assert mapper.stuck
    assert diagnose(mapper, wall, CONFIG).cause in {Cause.IN_OBSTACLE}
    place = nearest_free_place(mapper, wall, 8.0)
    assert mapper.belief.at(place.position) == 0
    assert wall.distance_to(place.position) < 1.5
    assert not mapper.stuck
    assert nearest_free_place(mapper, Pose(-300.0, 0.0), 8.0) is None


def test_the_causes_of_standing_still():
    empty = Mapper(MappingConfig(), lattice_origin=(0.0, 0.0))
    assert diagnose(None, Pose(0.0, 0.0), CONFIG).cause is Cause.NO_MAP
    assert diagnose(empty, None, CONFIG).cause is Cause.NO_MAP
    assert not diagnose(None, None, CONFIG).final
    mapper, pose = looked(ROOMS)
    assert diagnose(mapper, pose, CONFIG).final
