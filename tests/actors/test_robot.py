import pytest

from actors.robot import Robot
from actors.simulators.grid import GridSimulator
from common.config import MappingConfig, SimulatorConfig
from tests.actors.worlds import draw

MAPPING = MappingConfig(resolution=0.5, sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0)
ROOM = draw("##########", "#S.......#", "#........#", "#........#", "##########", lattice=(1.5, 1.5))


@pytest.fixture
def robot():
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=720), MAPPING.sensor_range)
    made = Robot(simulator, MAPPING, ROOM, seed=0)
    made.update()
    return made


def test_a_robot_has_looked_around_before_it_drives(robot):
    assert robot.pose.position == ROOM.start
    assert robot.positions == [ROOM.start]
    assert len(robot.mapper.viewpoints) > 1
    assert robot.observe().viewpoints == len(robot.mapper.viewpoints)


def test_a_way_is_driven_from_corner_to_corner(robot):
    x, y = ROOM.start
    way = [(x + 2.0, y), (x + 2.0, y - 1.5)]
    assert robot.drive(way, done=lambda: False)
    assert robot.positions == [ROOM.start, *way]
    assert robot.corners == [1]
    assert robot.distance == pytest.approx(3.5)
    assert robot.mapping_seconds > 0.0


def test_a_robot_stops_at_the_corner_where_it_is_done(robot):
    x, y = ROOM.start
    assert robot.drive([(x + 2.0, y), (x + 4.0, y)], done=lambda: True)
    assert robot.pose.position == (x + 2.0, y)
    assert robot.corners == []


def test_a_robot_beside_its_viewpoint_goes_there(robot):
    x, y = ROOM.start
    robot.drive([(x + 0.7, y)], done=lambda: False)
    viewpoint = robot.mapper.position(robot.mapper.robot)
    robot.go_to_viewpoint(done=lambda: False)
    assert robot.pose.distance_to(viewpoint) < 1e-6
    robot.go_to_viewpoint(done=lambda: False)
    assert len(robot.positions) == 3
