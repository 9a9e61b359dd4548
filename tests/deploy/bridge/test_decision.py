"""Where the robot is sent, when it has to stand, and when its task is over: the decision loop without topics."""

from math import hypot

import numpy as np
import pytest

from common.geometry import Pose, Scan
from common.planners.base import Plan, Status
from deploy.bridge.completion import CompletionChecks
from deploy.bridge.mission import Phase
from deploy.mapping.robot_map import RobotMap
from tests.common.planners.worlds import ARMS, DEAD_END, ROOM, ROOMS
from tests.deploy.bridge.offline import MAPPING, Trial, ended, settings


class Scripted:
    """A planner whose decisions are written down: a function of how often it was asked."""

    name = "scripted"
    tasks = frozenset({"exploration", "navigation"})

    def __init__(self, decide):
        self.decide = decide
        self.asked = 0

    def reset(self, task, target, seed):
        self.asked = 0

    def plan(self, mapper, pose):
        self.asked += 1
        return self.decide(self.asked, mapper, pose)


def started(world, planner=None, **sections):
    trial = Trial(world, settings(**sections), planner)
    trial.mission.start()
    return trial


@pytest.mark.parametrize("planner", ["greedy", "nearest", "tare"])
def test_a_world_is_explored_to_the_end_and_the_end_says_why(planner):
    trial = started(ROOMS, decision={"planner": planner})
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("complete: no frontier is left")
    assert last.unseen is None
    assert 50.0 < trial.distance < 200.0
    # Every waypoint was known free, and each but the last of the checks held the robot.
    assert [o.hold[:7] for o in trial.outcomes if o.hold].count("check 1") >= 1
    assert last.relieved == ""


def test_a_target_is_reached_and_the_next_one_too():
    trial = started(ARMS, decision={"task": "navigation", "planner": "astar", "goal": [6.0, 14.0]})
    last = trial.run(120, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.pose.distance_to((6.0, 14.0)) <= 0.8
    trial.mission.goal((46.0, 6.0))
    assert trial.run(200, ended).orders.phase is Phase.FINISHED
    assert trial.pose.distance_to((46.0, 6.0)) <= 0.8


def test_an_exploration_is_left_for_a_target_and_completed_afterwards():
    # A planner that knows no targets, and a robot that is to come home when the exploration is done, not before.
    trial = started(ROOMS, decision={"planner": "nearest", "return_home": True})
    assert trial.run(60, lambda o: o.pose is not None and o.pose.distance_to(ROOMS.start) > 4.0).orders.moving
    home = ROOMS.start
    trial.mission.goal(home)
    last = trial.run(60, ended)
    assert (last.orders.phase, last.orders.task.name) == (Phase.FINISHED, "navigation")
    assert trial.pose.distance_to(home) <= 0.8
    trial.mission.start()
    assert trial.run(300, lambda o: o.orders.phase is Phase.RETURNING).orders.reason.startswith("the task is done")
    assert trial.run(100, ended).orders.task.name == "exploration"
    assert trial.pose.distance_to(home) <= 0.8


def test_a_target_that_cannot_be_reached_fails_after_several_checks():
    trial = started(ROOM, decision={"task": "navigation", "planner": "astar", "goal": [2.0, 2.0]})
    last = trial.run(60, ended)
    assert last.orders.phase is Phase.FAILED
    assert "obstacle" in last.orders.reason
    assert any(o.hold.startswith("check 4 of 5") for o in trial.outcomes)


@pytest.mark.parametrize("commands", [["return_home", "pause"], ["return_home", "", "pause", "reset"]])
def test_a_way_home_that_is_paused_goes_on_home(commands):
    """It began anew, as for a new map, while the robot stood, and then explored on its way home."""
    trial = started(ROOMS, decision={"planner": "nearest"})
    assert trial.run(60, lambda o: o.pose is not None and o.pose.distance_to(ROOMS.start) > 4.0).orders.moving
    for command in commands:
        if command:
            getattr(trial.mission, command)()
        else:
            trial.run(0.5)
    trial.run(0.5)
    trial.mission.resume()
    last = trial.run(30, ended)
    assert last.orders.phase is Phase.FINISHED
    assert trial.pose.distance_to(ROOMS.start) <= 0.8


def test_after_a_wait_a_planner_that_gave_up_its_target_begins_anew():
    """Planners leave out for good what they failed at; a box on the way stood there for a while only."""

    def decide(asked, mapper, pose):
        if asked == 1:
            return Plan(Status.GOING, waypoint=(pose.x + 4.0, pose.y))
        return Plan(Status.UNREACHABLE, reason="it was tried in vain")

    goal = ROOMS.start[0] + 8.0, ROOMS.start[1]
    trial = started(
        ROOMS, Scripted(decide), decision={"task": "navigation", "goal": goal}, safety={"blacklist_time": 3.0}
    )
    trial.frozen = True
    ways = []
    for _ in range(100):
        before, now = trial.outcomes[-1].course if trial.outcomes else None, trial.tick().course
        if now is not None and before is None:
            ways.append(trial.now)
            trial.loop.report_blocked("a box")
    # Now and then within the first ban, and once after it: bans are given up after two failures.
    assert 3 <= len(ways) <= 7
    assert 3.0 < ways[-1] - ways[0] < 4.5
    assert trial.outcomes[-1].orders.phase is Phase.FAILED


def test_one_empty_graph_is_not_the_end():
    trial = started(ROOM)
    first = trial.tick()
    assert first.orders.phase is Phase.RUNNING
    assert first.hold.startswith("check 1 of 5: complete: no frontier is left")
    # The same map again is no further check.
    trial.sensing = False
    for _ in range(5):
        trial.tick()
    assert trial.outcomes[-1].checks <= 1
    trial.sensing = True
    assert trial.run(5, ended).orders.phase is Phase.FINISHED


def test_something_to_do_again_begins_the_checks_anew():
    def decide(asked, mapper, pose):
        if asked in {1, 2, 4}:
            return Plan(Status.COMPLETE, reason="nothing")
        return Plan(Status.GOING, waypoint=(pose.x + 0.6, pose.y))

    trial = started(ROOM, Scripted(decide))
    holds = [trial.tick().hold[:7] for _ in range(30)]
    assert "check 2" in holds
    assert holds.index("check 2") < len(holds) - 1 - holds[::-1].index("check 1")


def test_checks_count_new_maps_alone():
    checks = CompletionChecks(3)
    assert not any(checks.passed(7, 0.1 * tick) for tick in range(10))
    assert not checks.passed(8, 1.0)
    assert checks.passed(9, 1.1)


def test_checks_count_a_map_again_that_stays_as_it_is():
    checks = CompletionChecks(3)
    assert [checks.passed(7, float(second)) for second in range(7)] == [False] * 6 + [True]


def test_without_a_map_the_robot_waits_and_says_so():
    trial = started(ROOM)
    trial.sensing = False
    last = trial.run(3)
    assert last.orders.moving
    assert "no scan received yet" in last.hold
    trial.sensing = True
    assert trial.run(5, ended).orders.phase is Phase.FINISHED


def test_a_robot_too_large_for_its_place_waits_and_says_what_to_do():
    trial = started(ROOMS, mapping={**MAPPING, "robot_radius": 8.0})
    last = trial.run(3)
    assert last.orders.moving
    assert "a robot that needs 8 m of room fits nowhere near" in last.hold
    assert "lower mapping.robot_radius" in last.hold


def test_viewpoints_far_apart_leave_nothing_unseen():
    """Four squares of 24 m: what their few viewpoints do not resolve is looked at from the edge of the unknown."""
    trial = started(ROOMS, mapping={**MAPPING, "viewpoint_spacing": 24.0}, decision={"planner": "greedy"})
    last = trial.run(300, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("complete")
    assert last.unseen is None
    assert last.mapper.explored_area > 0.999 * np.count_nonzero(ROOMS.free) * ROOMS.resolution**2


def test_stale_scans_hold_the_robot_and_fresh_ones_let_it_go():
    trial = started(ROOMS)
    trial.run(3)
    trial.sensing = False
    last = trial.run(1.5)
    assert last.course is None
    assert "no scan for 1." in last.hold
    trial.sensing = True
    assert trial.run(2).course is not None


def test_a_pose_that_jumps_holds_the_robot_until_poses_are_steady():
    trial = started(ROOMS)
    trial.run(3)
    trial.health.heard_pose(trial.now, trial.now, Pose(trial.pose.x + 5.0, trial.pose.y))
    assert "the pose jumped" in trial.tick().hold
    assert trial.run(3).course is not None


def test_a_planner_that_fails_is_relieved_by_the_fallback_and_tried_again_later():
    def decide(asked, mapper, pose):
        raise ZeroDivisionError("no such thing")

    trial = started(ROOMS, Scripted(decide), decision={"relief": 5.0})
    first = trial.tick()
    assert first.course is None
    assert "scripted failed: ZeroDivisionError" in first.hold
    assert [fault.kind.value for fault in first.faults] == ["policy_error"]
    second = trial.tick()
    assert second.course is not None
    assert second.planner == "nearest"
    assert "ZeroDivisionError" in second.relieved
    assert second.faults == ()
    asked = trial.planners.main.asked
    trial.run(8)
    assert trial.planners.main.asked > asked


def test_a_planner_that_circles_is_relieved():
    places = [(6.0, 8.0), (10.0, 8.0)]

    def decide(asked, mapper, pose):
        here = min(places, key=pose.distance_to)
        there = places[1 - places.index(here)] if pose.distance_to(here) < 0.1 else here
        return Plan(Status.GOING, waypoint=there)

    trial = started(ROOMS, Scripted(decide), safety={"progress_time": 1000.0})
    last = trial.run(60, lambda o: bool(o.relieved))
    assert "circles through 2 waypoints" in last.relieved
    assert trial.run(300, ended).orders.phase is Phase.FINISHED


def test_a_robot_that_passed_its_waypoint_at_a_distance_decides_anew_at_the_end_of_its_route():
    # Its local planner went around something at the waypoint, and has nothing left to drive.
    # The beacon is no viewpoint, so that nobody can say that there is nothing left to see.
    plan = Plan(Status.GOING, waypoint=(10.0, 6.0), beacon=(8.0, 8.0), path=[(10.0, 10.0)])
    trial = started(ROOM, Scripted(lambda *_: plan))
    assert trial.run(1).course.route == ((10.0, 6.0), (10.0, 10.0))
    trial.frozen = True
    while trial.pose.distance_to((10.0, 10.0)) > 0.01:
        trial._drive((10.0, 10.0), 0.2)
        trial.tick()
    asked = trial.planners.main.asked
    trial.run(2)
    assert trial.planners.main.asked > asked


def test_a_waypoint_that_cannot_be_reached_is_left_alone_for_a_while():
    trial = started(ROOMS, safety={"progress_time": 3.0, "blacklist_time": 10.0})
    trial.frozen = True
    before = trial.run(2).course.waypoint
    last = trial.run(5, lambda o: bool(o.bans))
    assert "no new area" in last.relieved
    after = trial.run(1).course
    assert before in last.bans
    assert after is None or after.waypoint != before
    trial.frozen = False
    assert trial.run(300, ended).orders.phase is Phase.FINISHED


@pytest.mark.parametrize(
    "task", [{"planner": "nearest"}, {"task": "navigation", "planner": "astar", "goal": [42.0, 6.0]}]
)
def test_a_robot_that_does_not_move_at_all_is_no_sign_that_places_are_out_of_reach(task, caplog):
    trial = started(
        DEAD_END if "goal" not in task else ROOMS, decision=task, safety={"progress_time": 3.0, "blacklist_time": 12.0}
    )
    trial.frozen = True
    last = trial.run(120, ended)
    assert last.orders.moving
    assert len(last.bans) <= 2
    assert last.relieved.startswith("the robot does not move, wherever it is sent")
    assert "the robot does not move" in caplog.text
    trial.frozen = False
    assert trial.run(300, ended).orders.phase is Phase.FINISHED


def test_time_in_other_hands_is_no_time_without_progress():
    trial = started(ROOMS, safety={"progress_time": 3.0, "blacklist_time": 10.0})
    trial.frozen = trial.in_other_hands = True
    assert not trial.run(10).bans
    trial.in_other_hands = False
    assert trial.run(5, lambda o: bool(o.bans)).bans


def test_a_blocked_way_is_left_at_once():
    trial = started(ROOMS)
    waypoint = trial.run(2).course.waypoint
    trial.loop.report_blocked("a box stands in the way")
    outcome = trial.tick()
    assert waypoint in outcome.bans
    assert outcome.course is None or outcome.course.waypoint != waypoint


def test_a_waypoint_that_is_no_longer_free_is_replaced_in_the_same_pass():
    trial = started(ROOMS)
    waypoint = trial.run(1.5).course.waypoint
    # Into the middle of the waypoint's cell, whose corner the waypoint is.
    x, y = waypoint[0] + 0.25 - trial.pose.x, waypoint[1] + 0.25 - trial.pose.y
    bearing, distance = np.arctan2(y, x), hypot(x, y)
    box = Scan(np.array([distance], dtype=np.float32), float(bearing) - trial.pose.yaw, 0.1, 10.0)
    trial.map.add(box, trial.pose)
    assert trial.map._mapper.belief.at(waypoint) > 0
    outcome = trial.tick()
    assert outcome.decided
    assert outcome.course is not None
    assert outcome.course.waypoint != waypoint


def test_the_geofence_is_never_left_and_ends_the_exploration():
    fence = [[0.0, 0.0], [30.0, 0.0], [30.0, 24.0], [0.0, 24.0]]
    trial = started(ARMS, mapping={**MAPPING, "robot_radius": 0.5}, safety={"geofence": fence})
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.orders.reason.startswith("not complete: ")
    assert "outside the geofence" in last.orders.reason
    # Where it is not complete is said: the corridor continues behind the fence.
    assert last.unseen is not None
    assert last.unseen.length >= 2.0
    assert last.unseen.position[0] > 28.0
    edge = 30.0 - trial.config.mapping.robot_radius
    assert all(o.course.waypoint[0] <= edge for o in trial.outcomes if o.course)
    assert max(o.pose.x for o in trial.outcomes) <= edge


def test_the_robot_drives_home_when_it_is_done():
    trial = started(DEAD_END, decision={"return_home": True})
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert "back where it began" in last.orders.reason
    assert trial.pose.distance_to(DEAD_END.start) <= 0.8
    assert any(o.orders.phase is Phase.RETURNING and o.planner == "astar" for o in trial.outcomes)


def test_pause_holds_and_resume_goes_on_with_the_same_task():
    trial = started(ROOMS)
    trial.run(3)
    trial.mission.pause()
    assert trial.tick().course is None
    here = trial.pose
    trial.run(2)
    assert trial.pose == here
    trial.mission.resume()
    assert trial.tick().course is not None
    trial.mission.abort()
    assert trial.tick().orders.phase is Phase.ABORTED


def test_reset_forgets_the_map_and_the_task_goes_on():
    trial = started(ROOMS)
    trial.run(20)
    known = trial.outcomes[-1].mapper.belief.known_cells
    trial.mission.reset()
    trial.tick()
    outcome = trial.tick()
    assert outcome.mapper.belief.known_cells < known
    assert trial.run(300, ended).orders.phase is Phase.FINISHED


def test_a_robot_whose_place_is_not_free_by_the_map_starts_from_the_nearest_place_that_is():
    trial = started(ROOMS)
    trial.run(2)
    wall = Pose(trial.pose.x, 3.9)
    assert trial.map._mapper.belief.at(wall.position) != 0
    trial.simulator.scan = lambda: None
    trial.health.reset()
    trial.pose = wall
    trial.frozen = True
    trial.map.add(None, wall)
    trial.health.heard_sensor(trial.now)
    trial.health.updated_map(trial.now)
    outcome = trial.run(0.9, lambda o: o.decided)
    assert outcome.course is not None
    assert outcome.mapper.belief.at(outcome.course.route[0]) == 0


def test_it_works_on_the_robots_own_map_at_negative_coordinates():
    class Shifted(RobotMap):
        """Everything 100 m to the lower left."""

        def __init__(self, mapping, lattice):
            super().__init__(config)
            self.now = 0.0

        def add(self, scan, pose):
            self.now += 0.1
            self.add_pose(self.now, Pose(pose.x - 100.0, pose.y - 100.0, pose.yaw))
            self.add_scan(self.now, scan)

    spacing = {**MAPPING, "resolution": 0.25, "viewpoint_spacing": 2.0}
    config = settings(mapping=spacing, sensing={"range_noise": 0.0}, safety={"pose_jump": 1000.0})
    trial = Trial(DEAD_END, config, make_map=Shifted)
    trial.mission.start()
    drive = trial._drive
    trial._drive = lambda waypoint, length: drive((waypoint[0] + 100.0, waypoint[1] + 100.0), length)
    last = trial.run(200, ended)
    assert last.orders.phase is Phase.FINISHED
    assert last.mapper.explored_area > 40.0
    assert all(o.course.waypoint[0] < 0 for o in trial.outcomes if o.course)
