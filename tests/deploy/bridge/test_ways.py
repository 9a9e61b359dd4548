"""Ways of the graph as the robot drives them: corners, aims of foreign stacks, detours, ways out of tight places."""

from itertools import pairwise

import numpy as np
import pytest

from actors.maps.grid_map import GridMap
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Status
from deploy.bridge.aim import FARTHEST, Aim
from deploy.bridge.detour import detour
from deploy.bridge.diagnosis import Cause, diagnose
from deploy.bridge.legs import begun_at, drivable
from deploy.bridge.mission import Phase
from deploy.bridge.way_out import way_out
from tests.common.planners.worlds import CONFIG, ROOMS, looked
from tests.deploy.bridge.offline import Trial, ended, settings

NARROW = {"resolution": 0.25, "sensor_range": 10.0, "beacon_range": 10.0, "robot_radius": 0.25}


def narrow(door: float) -> GridMap:
    """Two rooms of 8 m x 8 m, 0.25 m cells, with a door in a thick wall between two columns of a lattice of 2 m."""
    free = np.zeros((34, 70), dtype=bool)
    free[1:33, 1:33] = free[1:33, 37:69] = True
    width = round(door / 0.25)
    free[17 : 17 + width, 33:37] = True
    return GridMap("narrow", free, 0.25, (0.0, 0.0), (2.0, 2.0), None, None, (1.0, 1.0))


def narrow_trial(spacing=2.0, **sections):
    trial = Trial(narrow(0.75), settings(mapping={**NARROW, "viewpoint_spacing": spacing}, **sections))
    trial.mission.start()
    return trial


@pytest.mark.parametrize("spacing", [1.0, 2.0, 4.0])
def test_a_door_as_wide_as_the_robot_is_driven_through_at_any_spacing(spacing):
    trial = narrow_trial(spacing)
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("complete")
    assert max(o.pose.x for o in trial.outcomes) > 9.0
    assert last.mapper.explored_area > 120.0


def test_a_target_behind_such_a_door_is_reached():
    trial = narrow_trial(decision={"task": "navigation", "planner": "astar", "goal": [14.0, 2.0]})
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED, last.orders.reason
    assert trial.pose.distance_to((14.0, 2.0)) <= 0.8


def test_home_is_found_through_such_a_door():
    trial = narrow_trial(decision={"return_home": True})
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.pose.distance_to((2.0, 2.0)) <= 0.8


def test_what_the_robot_cannot_get_to_for_bans_is_waited_for_and_no_end():
    """Bans pass; an exploration that took a banned door for a wall ended with half of a building unseen."""
    trial = narrow_trial(4.0, safety={"blacklist_time": 20.0})

    def through_door(outcome):
        return outcome.course is not None and outcome.course.waypoint[0] > 8.5 and outcome.pose.x < 7.5

    held = None
    for _ in range(12):
        if not through_door(trial.run(100, lambda o: through_door(o) or "tries again" in o.hold)):
            held = trial.outcomes[-1]
            break
        trial.loop.report_blocked("somebody stands in the door")
        trial.tick()
    assert held is not None
    assert "somebody stands in the door" in held.hold
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.mapper.explored_area > 120.0


def seen_whole(world: GridMap, config: MappingConfig, pose: Pose) -> Mapper:
    """A mapper that knows a whole world."""
    mapper = Mapper(config, lattice_origin=world.lattice_origin)
    mapper.belief.assign(np.where(world.free, 0, 100).astype(np.int8), world.origin)
    mapper.update(pose)
    return mapper


@pytest.fixture(scope="module")
def corner():
    """The mapper of two rooms, seen whole, a pose in the first, and the nodes on both sides of the door's bend."""
    pose = Pose(2.0, 2.0)
    mapper = seen_whole(narrow(0.75), MappingConfig(**NARROW, viewpoint_spacing=4.0), pose)
    bent = [(a, b) for a, b in mapper.edges.tolist() if len(mapper.way(a, b)) > 1]
    assert bent, "the door is no straight line between viewpoints"
    return mapper, *bent[0]


def test_a_route_follows_the_corners_of_edges_that_are_not_straight(corner):
    mapper, a, b = corner
    start, end = mapper.position(a), mapper.position(b)
    plan = Plan(Status.GOING, waypoint=start, path=[end])
    route = drivable(mapper, plan, lambda *_: True)
    assert route == (start, *mapper.way(a, b))
    for here, there in pairwise(route):
        assert mapper.segment_free(here, there)
    assert drivable(mapper, plan, lambda _, there: there != end) == (start,)
    assert drivable(mapper, Plan(Status.GOING, waypoint=start, path=[(40.0, 40.0)]), lambda *_: True) == (start,)


def test_an_aim_is_in_sight_near_and_walks_along_the_corners(corner):
    mapper, a, b = corner
    way = [*mapper.way(a, b)]
    pose = Pose(*mapper.position(a))
    aim = Aim(pose, way, 0.5)
    aims = []
    for _ in range(400):
        there = aim.advance(mapper, pose)
        assert pose.distance_to(there) <= FARTHEST
        assert mapper.segment_free(pose.position, there)
        aims += [there] if not aims or aims[-1] != there else []
        gap = pose.distance_to(there)
        if gap < 1e-9:
            break
        step = min(0.1, gap) / gap
        pose = Pose(pose.x + step * (there[0] - pose.x), pose.y + step * (there[1] - pose.y))
    assert aims[-1] == mapper.position(b)
    assert set(aims) <= set(way)


def test_a_long_leg_is_parted_and_the_far_end_taken_when_it_is_near_enough():
    mapper, pose = looked(ROOMS)
    end = (pose.x + 9.0, pose.y)
    aim = Aim(pose, [end], 0.5)
    assert aim.advance(mapper, pose) == (pose.x + 4.5, pose.y)
    assert aim.advance(mapper, Pose(pose.x + 1.5, pose.y)) == end


def test_a_stack_that_stops_before_a_corner_is_sent_on():
    mapper, pose = looked(ROOMS)
    # The next place is behind a wall: only standing still tells that the corner is as good as reached.
    places = [(pose.x + 1.0, pose.y), (pose.x + 1.0, pose.y - 30.0)]
    aim = Aim(pose, places, 0.5)
    near = Pose(pose.x + 0.7, pose.y)
    assert aim.advance(mapper, pose) == places[0]
    assert aim.advance(mapper, near) == places[0]
    assert aim.advance(mapper, near) != places[0]


def test_a_plan_for_another_place_begins_with_the_way_there(corner):
    mapper, a, b = corner
    start, end = mapper.position(a), mapper.position(b)
    plan = Plan(Status.GOING, waypoint=end, via=mapper.way(a, b)[:-1])
    assert begun_at(mapper, Pose(*start), [], plan) is plan
    behind = next(place for place in mapper.viewpoints.tolist() if not mapper.segment_free(tuple(place), plan.via[0]))
    assert begun_at(mapper, Pose(*behind), [start], plan).via == [start, *plan.via]
    assert begun_at(mapper, Pose(*start), [start], plan) == plan


def test_a_detour_leads_around_what_is_banned():
    mapper, pose = looked(ROOMS)
    free = detour(mapper, pose, None, 4.0, lambda *_: True)
    assert free.status is Status.GOING
    around = detour(mapper, pose, None, 4.0, lambda _, there: there != free.waypoint)
    assert around.status is Status.GOING
    assert around.waypoint != free.waypoint
    assert free.waypoint not in around.path
    assert detour(mapper, pose, None, 4.0, lambda *_: False).status is Status.UNREACHABLE


def test_a_detour_takes_the_shortest_way_that_is_left():
    """The shortest path to a goal is closed at one place; another one leads there and must be found."""
    world = narrow(0.75)
    world.free[5:8, 33:37] = True
    pose = Pose(2.0, 4.5)
    mapper = seen_whole(world, MappingConfig(**NARROW, viewpoint_spacing=2.0), pose)
    mapper.target = (14.0, 4.5)
    mapper.update(pose)
    assert mapper.target_known
    free = detour(mapper, pose, mapper.target, 2.0, lambda *_: True)
    door = (8.75, height_at(pose, free, 8.75))
    assert door[1] == pytest.approx(4.6, abs=0.4)
    closed = detour(mapper, pose, mapper.target, 2.0, lambda a, b: distance_to_segment(door, a, b) > 0.7)
    assert closed.status is Status.GOING
    assert height_at(pose, closed, 8.75) < 2.5
    assert closed.path[-1] == mapper.target


def height_at(pose, plan, x):
    """Where a plan's way first crosses a line of constant x."""
    places = np.array([pose.position, *plan.via, plan.waypoint, *plan.path])
    k = int(np.flatnonzero(places[:, 0] > x)[0])
    share = (x - places[k - 1, 0]) / (places[k, 0] - places[k - 1, 0])
    return float(places[k - 1, 1] + share * (places[k, 1] - places[k - 1, 1]))


def distance_to_segment(point, a, b):
    a, b, point = map(np.array, (a, b, point))
    length = float(np.dot(b - a, b - a))
    along = 0.0 if length == 0.0 else min(max(float(np.dot(point - a, b - a)) / length, 0.0), 1.0)
    return float(np.hypot(*(a + along * (b - a) - point)))


def test_a_robot_in_a_tight_place_is_led_out_through_free_cells_and_not_through_the_wall():
    free = np.zeros((40, 40), dtype=bool)
    free[1:39, 1:20] = free[1:39, 21:39] = True
    # A niche of 0.5 m, closed on three sides, from the left room almost to the right one.
    free[18:22, 20] = False
    free[18, 10:20] = free[21, 10:20] = False
    world = GridMap("niche", free, 0.25, (0.0, 0.0), (2.0, 2.0), None, None, (1.0, 1.0))
    config = MappingConfig(**{**NARROW, "robot_radius": 0.3}, viewpoint_spacing=4.0)
    pose = Pose(4.6, 5.0)
    mapper = seen_whole(world, config, pose)
    assert mapper.stuck
    way = way_out(mapper, pose, 8.0)
    assert way
    assert not mapper.stuck
    assert all(x < 4.9 for x, _ in way)
    assert way[-1][0] < 2.5
    for place in way:
        assert mapper.belief.at(place) == 0
    assert mapper.has_room(way[-1])


def test_a_robot_in_a_wall_gets_the_nearest_place_with_room():
    mapper, pose = looked(ROOMS)
    wall = Pose(pose.x, 3.2)
    mapper.update(wall)
    assert mapper.stuck
    assert diagnose(mapper, wall, CONFIG).cause is Cause.IN_OBSTACLE
    way = way_out(mapper, wall, 8.0)
    assert mapper.belief.at(way[-1]) == 0
    assert wall.distance_to(way[-1]) < 1.5
    assert not mapper.stuck
    assert way_out(mapper, Pose(-300.0, 0.0), 8.0) == []


def test_the_causes_of_standing_still():
    empty = Mapper(MappingConfig(), lattice_origin=(0.0, 0.0))
    assert diagnose(None, Pose(0.0, 0.0), CONFIG).cause is Cause.NO_MAP
    assert diagnose(empty, None, CONFIG).cause is Cause.NO_MAP
    assert not diagnose(None, None, CONFIG).final
    mapper, pose = looked(ROOMS)
    found = diagnose(mapper, pose, CONFIG)
    assert found.final
    assert found.cause is Cause.LEFT_UNSEEN
    assert found.unseen is not None
    assert "m of frontier at the edge of what the robot can reach" in found.text


def test_a_robot_with_nothing_left_but_a_banned_door_looks_soon_whether_it_is_open():
    """Who stands in a door is gone long before a ban is over; the robot stood in an empty building for it."""
    trial = narrow_trial(4.0, safety={"blacklist_time": 120.0})

    def through_door(outcome):
        return outcome.course is not None and outcome.course.waypoint[0] > 8.5 and outcome.pose.x < 7.5

    for _ in range(12):
        if not through_door(trial.run(100, lambda o: through_door(o) or "tries again" in o.hold)):
            break
        trial.loop.report_blocked("somebody stands in the door")
        trial.tick()
    began = trial.now
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.mapper.explored_area > 120.0
    assert trial.now - began < 80.0
