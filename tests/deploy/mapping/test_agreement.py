"""What a robot maps from a simulator's scans is what the simulation itself believes."""

import numpy as np
import pytest

from actors.maps.sources import open_sources
from actors.simulators.grid import GridSimulator
from common.config import MappingConfig, SimulatorConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from deploy.mapping.robot_map import RobotMap
from tests.deploy.mapping.lidar import configure

SENSOR_RANGE = 20.0


@pytest.mark.parametrize("number", [0, 1])
def test_it_agrees_with_the_common_belief_in_99_percent_of_the_cells(number):
    world = open_sources(["generator:rooms"], 0.25, "exploration").world(number)
    mapping = MappingConfig(resolution=world.resolution, sensor_range=SENSOR_RANGE, viewpoint_spacing=4.0)
    config = configure(mapping=mapping.model_dump(), sensing={"range_min": 0.0})
    common = Mapper(mapping, lattice_origin=world.lattice_origin)
    robot_map = RobotMap(config)
    simulator = GridSimulator(SimulatorConfig(name="grid"), SENSOR_RANGE)
    pose = simulator.reset(world, seed=0)
    rng = np.random.default_rng(number)
    now = 0.0
    for _ in range(12):
        scan = simulator.scan()
        common.integrate(scan, pose)
        common.update(pose)
        # A lidar of 10 Hz scans a place more than once.
        for _ in range(4):
            now += 0.1
            robot_map.add_pose(now, pose)
            robot_map.add_scan(now, scan)
        mapper = robot_map.refresh()
        node = int(rng.choice(common.observe().waypoint_nodes()))
        leg = simulator.drive_to(common.position(node))
        pose = Pose(leg.pose.x, leg.pose.y, leg.pose.yaw)
    states, _, origin = robot_map.occupancy()
    theirs = common.belief.window(origin, states.shape)
    known = (states >= 0) | (theirs >= 0)
    assert np.count_nonzero(known) > 10_000
    assert (states[known] == theirs[known]).mean() >= 0.99
    assert mapper.belief.free_area == pytest.approx(common.belief.free_area, rel=0.02)
