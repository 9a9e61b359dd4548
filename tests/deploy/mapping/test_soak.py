"""Hours of clouds: memory must not grow."""

import numpy as np
import psutil
import pytest

from common.geometry import Pose
from deploy.mapping.robot_map import RobotMap
from tests.deploy.mapping.lidar import cloud_at, configure, room


def soak(clouds: int) -> list[float]:
    """Feed clouds of a robot that goes round and round, and return the resident memory along the way, MB."""
    robot_map = RobotMap(
        configure(
            sensing={"source": "points"},
            mapping={"resolution": 0.2},
            driving={"robot_radius": 0.25, "clearance": 0.05},
        )
    )
    free = room()
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    poses = [Pose(4.5 + 2.0 * float(np.cos(a)), 5.0 + 2.0 * float(np.sin(a)), float(a)) for a in angles]
    seen = [cloud_at(free, pose, azimuths=2100) for pose in poses]
    process, memory = psutil.Process(), []
    for k in range(clouds):
        pose = poses[k % len(poses)]
        robot_map.add_pose(k / 10, pose)
        # A copy, as each message brings its own memory.
        robot_map.add_points(k / 10, seen[k % len(poses)].copy())
        robot_map.obstacles_near(pose, 4.0)
        if k % 5 == 4:
            assert robot_map.refresh() is not None
        if k % 10 == 9:
            memory.append(process.memory_info().rss / 2**20)
    statistics = robot_map.statistics
    assert statistics.integrated == clouds
    assert statistics.dropped == {}
    return memory


def check_flat(memory: list[float]) -> None:
    rest = memory[len(memory) // 4 :]
    assert max(rest) - min(rest) < 8.0, f"resident memory went from {min(rest):.1f} to {max(rest):.1f} MB"
    half = len(rest) // 2
    assert np.median(rest[half:]) - np.median(rest[:half]) < 3.0


def test_memory_stays_flat_over_half_a_minute_of_clouds():
    check_flat(soak(300))


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_memory_stays_flat_over_ten_minutes_of_clouds():
    """10 Hz clouds of about 30,000 points, fed as fast as possible."""
    check_flat(soak(6000))
