"""Occupancy from noisy scans."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.belief import Belief
from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.config import SensingConfig
from deploy.mapping.log_odds import Beams, LogOddsGrid
from tests.common.mapping.worlds import random_world
from tests.deploy.mapping.lidar import RESOLUTION, room, scan_at


def grid_of(noise: float = 0.0) -> LogOddsGrid:
    return LogOddsGrid(RESOLUTION, (0.0, 0.0), SensingConfig(range_noise=noise))


def window(grid: LogOddsGrid, shape: tuple[int, int]) -> np.ndarray:
    row, column = -grid.first_cell[0], -grid.first_cell[1]
    return grid.states[row : row + shape[0], column : column + shape[1]]


def integrate(grid: LogOddsGrid, scan: Scan, pose: Pose, times: int = 1) -> None:
    for _ in range(times):
        grid.integrate(Beams.from_scan(scan, 0.0, 12.0), pose)


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_what_stands_still_is_seen_as_the_common_belief_sees_it(seed):
    """The same traversal: cell by cell the same answer, but where beams of one scan contradict each other."""
    rng = np.random.default_rng(seed)
    free = random_world(rng, 24, 32)
    cells = np.argwhere(free)
    row, column = cells[rng.integers(len(cells))]
    pose = Pose((column + rng.random()) * RESOLUTION, (row + rng.random()) * RESOLUTION, float(rng.uniform(-3, 3)))
    scan = scan_at(free, pose, beams=180)
    belief = Belief(RESOLUTION, 12.0)
    belief.integrate(scan, pose)
    grid = grid_of()
    integrate(grid, scan, pose, 5)
    assert np.array_equal(window(grid, free.shape), belief.window((0.0, 0.0), free.shape))


def test_a_cell_changes_only_beyond_the_thresholds():
    grid = grid_of()
    wall = Scan(np.array([2.1], dtype=np.float32), 0.0, 0.1, 12.0)
    away = Scan(np.array([np.inf], dtype=np.float32), 0.0, 0.1, 12.0)
    pose, cell = Pose(0.1, 0.1), grid.number((2.2, 0.1))

    def state() -> int:
        return int(grid.states[cell[0] - grid.first_cell[0], cell[1] - grid.first_cell[1]])

    integrate(grid, away, pose)
    assert state() == UNKNOWN, "one miss is not enough"
    integrate(grid, away, pose)
    assert state() == FREE
    integrate(grid, wall, pose)
    assert state() == FREE, "one hit makes it doubtful, not occupied"
    integrate(grid, wall, pose, 2)
    assert state() == OCCUPIED
    integrate(grid, away, pose, 2)
    assert state() == OCCUPIED, "two misses make it doubtful, not free"


def test_a_person_who_walks_away_is_cleared_within_a_second_and_a_half():
    free = room()
    pose = Pose(4.0, 5.0)
    crowded = free.copy()
    crowded[20:22, 26:28] = False
    grid = grid_of(0.03)
    rng = np.random.default_rng(1)
    for _ in range(50):
        integrate(grid, scan_at(crowded, pose, noise=0.03, rng=rng), pose)
    assert (window(grid, free.shape)[20:22, 26] == OCCUPIED).all()
    for _ in range(15):
        integrate(grid, scan_at(free, pose, noise=0.03, rng=rng), pose)
    assert (window(grid, free.shape)[20:22, 26:28] == FREE).all()


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_walls_stay_where_they_are_in_noise_of_three_centimetres(shift):
    """Walls on cell borders, and walls in the middle of cells."""
    free = room()
    origin = (shift, shift)
    grid = grid_of(0.03)
    rng = np.random.default_rng(2)
    for pose in (Pose(4.0, 5.0), Pose(7.0, 3.0, 1.0), Pose(7.5, 7.5, 2.0), Pose(12.0, 5.2, -1.0)):
        for _ in range(15):
            integrate(grid, scan_at(free, pose, origin=origin, noise=0.03, rng=rng), pose)
    seen = window(grid, (42, 62))
    # True obstacles at a quarter of a cell's side: cells that hold no obstacle, and those that hold nothing else.
    offset = round(shift / 0.05)
    fine = np.zeros((42 * 5, 62 * 5), dtype=bool)
    fine[offset : offset + 200, offset : offset + 300] = np.kron(~free, np.ones((5, 5), dtype=bool))
    blocked = fine.reshape(42, 5, 62, 5).mean(axis=(1, 3))
    inner = np.zeros((42, 62), dtype=bool)
    inner[2:37, 2:57] = True
    assert (seen[(blocked == 0.0) & inner] == OCCUPIED).mean() < 0.005, "free space is not eaten"
    known = (blocked > 0.7) & inner & (seen != UNKNOWN)
    assert (seen[known] == OCCUPIED).all(), "obstacles do not vanish"


def test_a_thin_pole_is_not_talked_away_by_beams_beside_it():
    free = room()
    pose = Pose(4.0, 5.0)
    scan = scan_at(free, pose)
    ranges = scan.ranges.copy()
    ranges[360] = 3.1
    grid = grid_of(0.03)
    integrate(grid, Scan(ranges, scan.angle_min, scan.angle_increment, 12.0), pose, 3)
    row, column = grid.number((7.1, 5.0))
    assert grid.states[row - grid.first_cell[0], column - grid.first_cell[1]] == OCCUPIED


def test_readings_outside_the_limits():
    grid = grid_of()
    ranges = np.array([0.1, np.nan, -1.0, np.inf, 30.0], dtype=np.float32)
    beams = Beams.from_scan(Scan(ranges, 0.0, 1.0, 12.0), 0.3, 8.0)
    assert not beams.hits.any()
    assert np.array_equal(np.isfinite(beams.ranges), [False, False, False, True, True])
    grid.integrate(beams, Pose(0.0, 0.0))
    assert grid.number((0.0, 0.0))[0] - grid.first_cell[0] + 8.0 / RESOLUTION < grid.states.shape[0]


def test_it_grows_in_every_direction_and_keeps_what_it_knew():
    free = room()
    near, far = grid_of(), grid_of()
    for pose in (Pose(4.0, 5.0), Pose(12.0, 5.0)):
        integrate(near, scan_at(free, pose), pose, 3)
        moved = Pose(pose.x - 1000.0, pose.y - 500.0)
        integrate(far, scan_at(free, moved, origin=(-1000.0, -500.0)), moved, 3)
    row, column = -2000 - far.first_cell[0], -4000 - far.first_cell[1]
    assert np.array_equal(window(near, free.shape), far.states[row : row + 40, column : column + 60])
    with pytest.raises(MappingError, match="check"):
        integrate(far, scan_at(free, Pose(4.0, 5.0)), Pose(1e7, 0.0))
    with pytest.raises(MappingError, match="finite"):
        integrate(far, scan_at(free, Pose(4.0, 5.0)), Pose(float("nan"), 0.0))
