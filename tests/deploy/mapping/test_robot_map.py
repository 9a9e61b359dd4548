"""The robot's map as the bridge uses it."""

import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MappingError
from common.geometry import Pose
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.mapping.rims import close_rims, rim_offsets
from deploy.mapping.robot_map import RobotMap
from tests.common.mapping.worlds import random_world
from tests.deploy.mapping.lidar import RESOLUTION, cloud_at, configure, room, scan_at

ROOM_OF_BODY = {"resolution": 0.2, "robot_radius": 0.3}


def see(robot_map: RobotMap, free: np.ndarray, pose: Pose, start: float, *, scans: int = 3, **world: object) -> float:
    """Stand at a pose for some scans at 10 Hz and return the time."""
    for _ in range(scans):
        start += 0.1
        robot_map.add_pose(start, pose)
        robot_map.add_scan(start, scan_at(free, pose, **world))
    return start


def test_there_is_no_mapper_before_pose_and_map():
    robot_map = RobotMap(configure())
    assert robot_map.refresh() is None
    assert robot_map.occupancy() is None
    assert len(robot_map.obstacles_near(Pose(0.0, 0.0), 5.0)) == 0
    robot_map.add_pose(1.0, Pose(4.0, 5.0))
    assert robot_map.pose == Pose(4.0, 5.0)
    assert robot_map.refresh() is None
    robot_map.add_scan(1.0, scan_at(room(), Pose(4.0, 5.0)))
    mapper = robot_map.refresh()
    assert mapper is not None
    assert robot_map.refresh() is mapper


@pytest.mark.parametrize("origin", [(0.0, 0.0), (-107.3, -55.1), (3000.0, -4000.0)])
def test_it_explores_from_anywhere_in_the_map_frame(origin):
    """Starts off the lattice, and at negative and large coordinates."""
    robot_map = RobotMap(configure(mapping=ROOM_OF_BODY))
    see(robot_map, room(), Pose(origin[0] + 4.13, origin[1] + 5.07, 0.3), 0.0, origin=origin)
    mapper = robot_map.refresh()
    assert not mapper.stuck
    observation = mapper.observe()
    assert observation.beacon.any()
    assert len(observation.waypoint_nodes()) > 3


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.2, 0.25]))
def test_the_ways_of_the_graph_keep_the_robots_room_from_obstacles(seed, resolution):
    rng = np.random.default_rng(seed)
    free = random_world(rng, 40, 60)
    cells = np.argwhere(free)
    robot_map = RobotMap(configure(mapping={"resolution": resolution, "robot_radius": 0.3}))
    now = 0.0
    for row, column in cells[rng.integers(len(cells), size=3)]:
        pose = Pose((column + 0.5) * RESOLUTION, (row + 0.5) * RESOLUTION)
        now = see(robot_map, free, pose, now)
        mapper = robot_map.refresh()
    if mapper.stuck:
        return
    states, _, origin = robot_map.occupancy()
    obstacles = (np.argwhere(states == OCCUPIED)[:, ::-1] + 0.5) * resolution + np.array(origin)
    edges = mapper.edges
    for a, b in edges[rng.integers(max(len(edges), 1), size=min(len(edges), 60))].tolist():
        for start, end in pairwise([mapper.position(a), *mapper.way(a, b)]):
            points = np.array(start) + np.linspace(0.0, 1.0, 9)[:, None] * (np.array(end) - start)
            # Where its body is, is free by definition.
            points = points[np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y) > 1.0]
            gaps = np.maximum(np.abs(obstacles[None] - points[:, None]) - resolution / 2, 0.0)
            assert np.hypot(gaps[..., 0], gaps[..., 1]).min(initial=1.0) >= 0.3 - 1e-3


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.booleans())
def test_the_belief_is_always_the_map_but_for_rims_and_where_the_robot_stands(seed, exploring):
    """Updates only where something changed give what writing everything gives, growth and moving things included."""
    rng = np.random.default_rng(seed)
    config = configure(mapping={"resolution": 0.2, "robot_radius": 0.5}, sensing={"hole_area": 0.0})
    offsets = rim_offsets(0.2, 0.5)
    robot_map = RobotMap(config, None if exploring else (5.0, 5.0))
    free = random_world(rng, 40, 60)
    now = 0.0
    for _ in range(6):
        world = free.copy()
        row, column = rng.integers(2, 36), rng.integers(2, 56)
        world[row : row + 2, column : column + 2] = False
        cells = np.argwhere(world)
        row, column = cells[rng.integers(len(cells))]
        pose = Pose((column + rng.random()) * RESOLUTION, (row + rng.random()) * RESOLUTION)
        now = see(robot_map, world, pose, now, scans=2, range_max=6.0)
        belief = robot_map.refresh().belief
        states, resolution, origin = robot_map.occupancy()
        assert belief.shape == states.shape
        assert belief.origin == pytest.approx(origin)
        expected = states.copy()
        if exploring:
            close_rims(states, offsets, 3, (0, states.shape[0] - 1, 0, states.shape[1] - 1), expected)
        rows, columns = np.nonzero(belief.cells != expected)
        x, y = origin[0] + (columns + 0.5) * resolution, origin[1] + (rows + 0.5) * resolution
        away = np.hypot(x - pose.x, y - pose.y)
        assert (away <= config.driving.robot_radius + resolution).all(), "only the robot's own place differs"
        assert belief.known_cells == np.count_nonzero(belief.cells != UNKNOWN)


@pytest.mark.parametrize(("wall", "door"), [(0.2, 0.8), (0.3, 0.9), (1.0, 1.0)])
def test_a_door_seen_from_the_side_is_worth_a_look(wall, door):
    """Of what is behind a door in a thick wall, nothing shows from along the wall."""
    resolution = 0.05
    free = np.zeros((120, 160), dtype=bool)
    free[20:70, 20:140] = True
    end = 70 + round(wall / resolution)
    first = 100
    free[70:end, first : first + round(door / resolution)] = True
    free[end:110, 80:140] = True
    robot_map = RobotMap(configure(mapping={"resolution": 0.1, "robot_radius": 0.3, "viewpoint_spacing": 2.0}))
    see(robot_map, free, Pose(1.5, 2.5), 0.0, resolution=resolution)
    mapper = robot_map.refresh()
    doorway = (mapper.frontiers[:, 1] > 3.3) & (mapper.frontiers[:, 0] > 4.5)
    assert doorway.any()
    assert (mapper.observe().utility > 0).any()


@pytest.mark.parametrize("place", [(0.76, 5.0), (0.62, 0.62), (3.2, 3.3)])
def test_a_robot_beside_a_wall_or_inside_an_obstacle_is_not_stuck(place):
    """The last place lies behind the face of a pillar, as when the localisation is off by a little."""
    robot_map = RobotMap(configure(mapping=ROOM_OF_BODY))
    now = see(robot_map, room(), Pose(4.0, 5.0), 0.0)
    now = see(robot_map, room(), Pose(2.0, 2.0), now)
    robot_map.refresh()
    robot_map.add_pose(now + 0.1, Pose(*place))
    mapper = robot_map.refresh()
    assert mapper.belief.at(place) == FREE
    assert not mapper.stuck
    assert mapper.has_room(mapper.way_home()[-1])
    robot_map.add_pose(now + 0.2, Pose(6.0, 5.0))
    mapper = robot_map.refresh()
    assert not mapper.has_room((0.62, 5.0)), "room beside the wall is kept, wherever the robot was"


def test_the_target_can_change_without_losing_the_map():
    robot_map = RobotMap(configure(), target=(13.0, 5.0))
    see(robot_map, room(), Pose(4.0, 5.0), 0.0)
    mapper = robot_map.refresh()
    known = mapper.belief.known_cells
    assert mapper.observe().has_target
    robot_map.set_target((5.0, 5.0))
    assert robot_map.refresh() is mapper
    assert mapper.target == (5.0, 5.0)
    assert mapper.target_known
    robot_map.set_target(None)
    assert not robot_map.refresh().observe().has_target
    assert mapper.belief.known_cells == known


def test_reset_forgets_the_map_but_not_where_the_robot_is():
    robot_map = RobotMap(configure())
    now = see(robot_map, room(), Pose(4.0, 5.0), 0.0)
    old = robot_map.refresh()
    robot_map.reset(target=(9.0, 9.0))
    assert robot_map.refresh() is None
    assert robot_map.pose == Pose(4.0, 5.0)
    assert robot_map.statistics.free_area == 0.0
    see(robot_map, room(), Pose(4.0, 5.0), now)
    new = robot_map.refresh()
    assert new is not old
    assert new.target == (9.0, 9.0)


def test_statistics_tell_what_became_of_the_messages():
    robot_map = RobotMap(configure())
    now = see(robot_map, room(), Pose(4.0, 5.0), 0.0)
    broken = scan_at(room(), Pose(4.0, 5.0))
    robot_map.add_scan(now, type(broken)(broken.ranges, float("nan"), broken.angle_increment, 12.0), "base_link")
    robot_map.refresh()
    assert robot_map.statistics.dropped == {"scan refused": 1}
    assert "finite" in robot_map.statistics.problem
    robot_map.add_scan(now + 50.0, scan_at(room(), Pose(4.0, 5.0)))
    robot_map.refresh()
    statistics = robot_map.statistics
    assert (statistics.received, statistics.integrated, statistics.waiting) == (5, 3, 1)
    assert 30.0 < statistics.free_area < 140.0


def slam(free: np.ndarray, seen: slice) -> np.ndarray:
    cells = np.where(free, 0, 100).astype(np.int8)
    cells[:, : seen.start] = -1
    cells[:, seen.stop :] = -1
    return cells


def test_a_slam_map_may_grow_shrink_and_move():
    robot_map = RobotMap(configure(sensing={"source": "grid"}))
    robot_map.add_pose(1.0, Pose(-3.0, 5.0))
    free = room()
    robot_map.add_grid(1.0, slam(free, slice(0, 30))[:, :30], RESOLUTION, (-7.1, 0.05, 0.0))
    mapper = robot_map.refresh()
    assert not mapper.stuck
    first = mapper.belief.free_area
    cells = slam(free, slice(0, 50))
    grown = np.full((50, 75), -1, dtype=np.int8)
    grown[7:47, 11:71] = cells
    robot_map.add_grid(2.0, grown, RESOLUTION, (-7.1 - 11 * RESOLUTION, 0.05 - 7 * RESOLUTION, 0.0))
    assert robot_map.refresh() is mapper
    assert mapper.belief.free_area > first
    assert np.array_equal(mapper.belief.window((-7.1, 0.05), free.shape), cells)
    robot_map.add_grid(3.0, cells[:, :20], RESOLUTION, (-7.1, 0.05, 0.0))
    robot_map.refresh()
    assert (mapper.belief.window((-7.1, 0.05), free.shape)[:, 20:] == UNKNOWN).all(), (
        "the newest map is the whole truth"
    )


def test_slam_maps_of_other_cells_and_turned_ones_are_resampled():
    for resolution, yaw in ((0.05, 0.0), (0.3, 0.0), (0.05, 0.5)):
        robot_map = RobotMap(configure(sensing={"source": "grid"}))
        scale = round(10.0 / resolution)
        cells = np.zeros((scale, scale), dtype=np.int8)
        cells[:, scale // 2] = 100
        robot_map.add_grid(1.0, cells, resolution, (0.0, 0.0, yaw))
        rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        robot_map.add_pose(1.0, Pose(*(rotation @ [2.5, 5.0])))
        belief = robot_map.refresh().belief
        wall = rotation @ [(scale // 2 + 0.5) * resolution, 5.0]
        assert belief.at((float(wall[0]), float(wall[1]))) == OCCUPIED
        for x in (2.5, 8.0):
            inside = rotation @ [x, 5.0]
            assert belief.at((float(inside[0]), float(inside[1]))) == FREE


def test_bad_slam_maps_leave_the_last_one_in_place():
    robot_map = RobotMap(configure(sensing={"source": "grid"}))
    robot_map.add_pose(1.0, Pose(3.0, 5.0))
    robot_map.add_grid(1.0, slam(room(), slice(0, 60)), RESOLUTION, (0.0, 0.0, 0.0))
    known = robot_map.refresh().belief.known_cells
    for number, (cells, resolution) in enumerate(
        [(np.zeros((0, 0), dtype=np.int8), 0.05), (np.zeros((4, 4), dtype=np.int8), 0.0)]
    ):
        robot_map.add_grid(2.0 + number, cells, resolution, (0.0, 0.0, 0.0))
        assert robot_map.refresh().belief.known_cells == known
    robot_map.add_grid(1.5, np.zeros((4, 4), dtype=np.int8), 0.25, (0.0, 0.0, 0.0))
    assert robot_map.refresh().belief.known_cells == known
    assert robot_map.statistics.dropped == {"grid refused": 2, "grid outdated": 1}
    binary = np.minimum(slam(room(), slice(0, 60)), 1)
    robot_map.add_grid(5.0, binary, RESOLUTION, (0.0, 0.0, 0.0))
    assert robot_map.refresh().belief.known_cells == known
    assert "publish 100 instead of 1" in robot_map.statistics.problem
    robot_map.add_grid(9.0, np.full((40, 60), 50, dtype=np.int8), RESOLUTION, (0.0, 0.0, 0.0))
    robot_map.refresh()
    assert "grid_free" in robot_map.statistics.problem


def test_obstacles_come_from_the_newest_scan_and_stay_in_place_while_the_robot_moves():
    robot_map = RobotMap(configure())
    now = see(robot_map, room(), Pose(4.0, 5.0), 0.0)
    robot_map.add_pose(now + 0.1, Pose(4.3, 5.0))
    near = robot_map.obstacles_near(robot_map.pose, 2.5)
    assert np.hypot(near[:, 0] - 4.3, near[:, 1] - 5.0).max() <= 2.5
    # The pillar from (3.0, 2.5) to (3.5, 3.0).
    assert np.abs(near - [3.5, 3.0]).max(axis=1).min() < 0.05


def test_obstacles_of_a_robot_with_slam_alone_come_from_its_map():
    robot_map = RobotMap(configure(sensing={"source": "grid"}))
    robot_map.add_pose(1.0, Pose(3.0, 5.0))
    robot_map.add_grid(1.0, slam(room(), slice(0, 60)), RESOLUTION, (0.0, 0.0, 0.0))
    robot_map.refresh()
    near = robot_map.obstacles_near(Pose(3.0, 5.0), 3.0)
    assert len(near) > 3
    assert np.hypot(near[:, 0] - 3.0, near[:, 1] - 5.0).max() <= 3.0


def test_octomap_needs_clouds():
    with pytest.raises(MappingError, match="points"):
        RobotMap(configure(sensing={"octomap": True}))


def test_a_cloud_of_thirty_thousand_points_costs_little():
    """In processor time, so that a busy machine does not matter: intake and refresh below 20 ms per cloud."""
    robot_map = RobotMap(configure(sensing={"source": "points"}, mapping=ROOM_OF_BODY))
    costs = []
    for k in range(12):
        pose = Pose(4.0 + 0.1 * k, 5.0)
        cloud = cloud_at(room(), pose, azimuths=2100)
        assert len(cloud) > 25_000
        robot_map.add_pose(k / 10, pose)
        begin = time.thread_time()
        robot_map.add_points(k / 10, cloud)
        assert robot_map.refresh() is not None
        costs.append(time.thread_time() - begin)
    assert np.median(costs) < 0.02
    assert robot_map.statistics.explored_volume > 20.0


def test_threads_may_add_and_ask_while_the_map_is_refreshed():
    robot_map = RobotMap(configure())
    scan = scan_at(room(), Pose(4.0, 5.0))
    errors: list[BaseException] = []
    stop = threading.Event()

    def repeat(action):
        try:
            while not stop.is_set():
                action()
        except BaseException as error:  # noqa: BLE001 - the test reports whatever went wrong in the thread
            errors.append(error)

    stamps = iter(range(10**9))

    def feed():
        stamp = next(stamps) / 10
        robot_map.add_pose(stamp, Pose(4.0, 5.0))
        robot_map.add_scan(stamp, scan)
        time.sleep(0.001)

    def ask():
        robot_map.obstacles_near(Pose(4.0, 5.0), 4.0)
        assert robot_map.statistics.received >= 0
        robot_map.occupancy()
        time.sleep(0.001)

    threads = [threading.Thread(target=repeat, args=(action,)) for action in (feed, ask)]
    for thread in threads:
        thread.start()
    end = time.monotonic() + 30.0
    while robot_map.statistics.integrated < 30 and time.monotonic() < end and not errors:
        robot_map.refresh()
    robot_map.reset()
    stop.set()
    for thread in threads:
        thread.join()
    assert not errors


def test_a_robot_that_came_through_a_gap_too_narrow_by_its_map_goes_back_the_way_it_came():
    """A nook beside a long room, behind a gap as wide as the robot: from inside, the room is cut off."""
    free = np.zeros((24, 120), dtype=bool)
    free[2:12, 2:118] = True
    free[12, 11:13] = True
    free[13:20, 8:16] = True
    robot_map = RobotMap(configure(mapping={"resolution": RESOLUTION, "robot_radius": RESOLUTION + 0.02}))
    now = 0.0
    for y in np.arange(6.0, 17.0, 0.5) * RESOLUTION:
        now = see(robot_map, free, Pose(12.0 * RESOLUTION, float(y)), now, range_max=30 * RESOLUTION)
        mapper = robot_map.refresh()
    assert not mapper.segment_free(mapper.way_home()[-1], robot_map.pose.position)
    assert mapper.position(mapper.robot)[1] < 12 * RESOLUTION
    assert mapper.observe().beacon.any()
