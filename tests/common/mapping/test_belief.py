from __future__ import annotations

import numpy as np
import pytest

from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.belief import Belief
from tests.common.mapping.worlds import scan_of, world_of

FREE, OCCUPIED, UNKNOWN = 0, 100, -1


def beam(*ranges: float, range_max: float = 10.0, range_min: float = 0.0) -> Scan:
    """All beams of the scan point the same way: along the robot's yaw."""
    return Scan(np.array(ranges, dtype=np.float32), 0.0, 0.0, range_max, range_min)


def strip() -> Belief:
    return Belief(0.5, 8.0, bounds=(0.0, 0.0, 10.0, 1.0))


def test_a_beam_frees_what_it_passes_and_marks_what_it_meets():
    belief = strip()
    assert belief.integrate(beam(3.0), Pose(0.75, 0.25)) == 7
    np.testing.assert_array_equal(belief.cells[0, :9], [-1, 0, 0, 0, 0, 0, 0, 100, -1])
    assert (belief.cells[1] == UNKNOWN).all()
    assert belief.free_area == pytest.approx(6 * 0.25)
    assert belief.known_cells == 7


def test_a_wall_on_a_cell_border_belongs_to_the_cell_behind():
    for noise in (-5e-4, 0.0, 5e-4):
        belief = strip()
        belief.integrate(beam(3.25 + noise), Pose(0.75, 0.25))
        assert belief.cells[0, 8] == OCCUPIED
        assert belief.cells[0, 7] == FREE
    belief = strip()
    belief.integrate(beam(3.25), Pose(7.25, 0.25, np.pi))  # ends at x = 4 on its way to the left
    assert belief.cells[0, 7] == OCCUPIED
    assert belief.cells[0, 8] == FREE


def test_a_beam_into_a_common_corner_marks_no_wall():
    belief = Belief(0.5, 8.0, bounds=(0.0, 0.0, 5.0, 5.0))
    belief.integrate(beam(2.0 * 2**0.5), Pose(0.5, 0.5, np.pi / 4))
    assert not (belief.cells == OCCUPIED).any()
    assert belief.cells[4, 4] == FREE
    assert belief.cells[5, 5] == UNKNOWN


@pytest.mark.parametrize("reading", [5.0, 7.0, np.inf])
def test_a_reading_at_range_max_or_beyond_marks_no_wall(reading):
    belief = strip()
    belief.integrate(beam(reading, range_max=5.0), Pose(0.0, 0.25))
    assert (belief.cells[0, :10] == FREE).all()
    assert (belief.cells[0, 10:] == UNKNOWN).all()


def test_a_reading_beyond_the_sensor_range_counts_as_nothing_met():
    belief = strip()
    belief.integrate(beam(9.0, range_max=30.0), Pose(0.0, 0.25))
    assert (belief.cells[0, :16] == FREE).all()
    assert (belief.cells[0, 16:] == UNKNOWN).all()


def test_invalid_beams_carry_no_information():
    belief = strip()
    assert belief.integrate(beam(np.nan, -1.0, 0.4, -np.inf, range_min=0.5), Pose(0.25, 0.25)) == 0
    assert belief.integrate(beam(), Pose(0.25, 0.25)) == 0
    assert (belief.cells == UNKNOWN).all()
    assert belief.take_changes() is None


def test_a_wall_stays_and_free_space_may_turn_out_to_be_a_wall():
    belief = strip()
    belief.integrate(beam(6.1), Pose(0.25, 0.25))
    belief.integrate(beam(3.1), Pose(0.25, 0.25))
    assert belief.cells[0, 6] == OCCUPIED
    free = belief.free_area
    belief.integrate(beam(6.1), Pose(0.25, 0.25))
    assert belief.cells[0, 6] == OCCUPIED
    assert belief.cells[0, 12] == OCCUPIED
    assert belief.free_area == free == pytest.approx(11 * 0.25)


def test_the_whole_world_is_seen_without_a_wrong_cell():
    free = world_of("""
        ############
        #....#.....#
        #....#.....#
        #..........#
        #....#.....#
        ############""")
    belief = Belief(0.5, 20.0, bounds=(0.0, 0.0, 6.0, 3.0))
    for pose in (Pose(1.0, 1.0), Pose(2.75, 1.25, 0.3), Pose(4.5, 2.0, -2.0)):
        belief.integrate(scan_of(free, 0.5, (0.0, 0.0), pose, range_max=20.0, beams=720), pose)
    assert (belief.cells[free] == FREE).all()
    assert not (belief.cells[~free] == FREE).any()


def test_it_grows_in_every_direction_and_keeps_what_it_knew():
    belief = Belief(0.5, 4.0, anchor=(0.25, 0.0))
    assert belief.shape == (0, 0)
    for yaw, x, y in ((0.0, 30.0, 0.0), (np.pi / 2, 0.0, 30.0), (np.pi, -30.0, 0.0), (-np.pi / 2, 0.0, -30.0)):
        belief.integrate(beam(2.0), Pose(x + 0.1, y + 0.1, yaw))
    assert belief.at((31.0, 0.1)) == FREE
    assert belief.at((0.1, 31.0)) == FREE
    assert belief.at((-31.0, 0.1)) == FREE
    assert belief.at((0.1, -31.0)) == FREE
    assert belief.at((32.1, 0.1)) == OCCUPIED
    assert belief.at((0.1, -31.9)) == OCCUPIED
    assert belief.at((500.0, 0.0)) == UNKNOWN
    assert belief.generation > 0
    row, column = belief.cell((31.0, 0.1))
    assert belief.cells[row, column] == FREE
    # The corners of cells stay where they were.
    assert (belief.origin[0] - 0.25) / 0.5 == pytest.approx(round((belief.origin[0] - 0.25) / 0.5))


def test_a_scan_inside_its_bounds_does_not_grow_it():
    free = np.ones((20, 20), dtype=np.bool_)
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    belief = Belief(0.5, 50.0, bounds=(0.0, 0.0, 10.0, 10.0))
    pose = Pose(5.0, 5.0)
    belief.integrate(scan_of(free, 0.5, (0.0, 0.0), pose, range_max=50.0, beams=720), pose)
    assert belief.shape == (20, 20)
    assert belief.origin == (0.0, 0.0)
    assert belief.generation == 0


def test_window_compares_a_grown_belief_with_a_true_map():
    belief = Belief(0.5, 8.0, bounds=(0.0, 0.0, 4.0, 4.0))
    belief.integrate(beam(6.1), Pose(2.25, 2.25, np.pi))
    assert belief.origin[0] < 0.0
    window = belief.window((0.0, 0.0), (8, 8))
    np.testing.assert_array_equal(window[4], [0, 0, 0, 0, 0, -1, -1, -1])
    wide = belief.window((-100.0, 0.0), (8, 208))
    np.testing.assert_array_equal(wide[:, 200:], window)
    assert (wide[:, :180] == UNKNOWN).all()


def test_assign_takes_an_occupancy_grid():
    belief = Belief(0.5, 8.0)
    cells = np.array([[0, 100, -1], [0, 0, 0]], dtype=np.int8)
    belief.assign(cells, (-1.0, 2.0))
    np.testing.assert_array_equal(belief.window((-1.0, 2.0), (2, 3)), cells)
    assert belief.free_area == pytest.approx(4 * 0.25)
    belief.assign(np.array([[-1, 0]], dtype=np.int8), (-1.0, 2.0))
    assert belief.free_area == pytest.approx(4 * 0.25)
    assert belief.known_cells == 4
    with pytest.raises(MappingError, match="-1, 0 and 100"):
        belief.assign(np.array([[50]], dtype=np.int8), (0.0, 0.0))


def test_cells_cannot_be_changed_behind_its_back():
    with pytest.raises(ValueError, match="read-only"):
        strip().cells[0, 0] = 0


@pytest.mark.parametrize("pose", [Pose(np.nan, 0.0), Pose(0.0, np.inf), Pose(0.0, 0.0, np.nan)])
def test_a_pose_that_is_not_finite_is_refused(pose):
    with pytest.raises(MappingError, match="finite pose"):
        strip().integrate(beam(1.0), pose)


def test_a_pose_beyond_reason_is_refused():
    belief = strip()
    belief.integrate(beam(1.0), Pose(1.0, 0.5))
    with pytest.raises(MappingError, match="check the robot's pose"):
        belief.integrate(beam(1.0), Pose(1e9, 0.5))
    with pytest.raises(MappingError, match="check the robot's pose"):
        belief.integrate(beam(1.0), Pose(1e300, 0.5))


def test_empty_bounds_are_refused():
    with pytest.raises(MappingError, match="x_min < x_max"):
        Belief(0.5, 8.0, bounds=(0.0, 0.0, 0.0, 1.0))
