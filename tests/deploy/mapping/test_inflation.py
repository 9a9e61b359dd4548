"""Room for the robot's body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from deploy.mapping.inflation import footprint, inflate, inflation_offsets


def inflated(states: np.ndarray, offsets: np.ndarray, box: tuple[int, int, int, int] | None = None) -> np.ndarray:
    box = box or (0, states.shape[0] - 1, 0, states.shape[1] - 1)
    out = np.empty((box[1] - box[0] + 1, box[3] - box[2] + 1), dtype=np.int8)
    inflate(states, offsets, int(np.abs(offsets).max(initial=0)), box, out)
    return out


def squares_apart(a: tuple[int, int], b: tuple[int, int], resolution: float) -> float:
    gap = np.maximum(np.abs(np.subtract(a, b)) - 1, 0) * resolution
    return float(np.hypot(*gap))


@given(st.sampled_from([0.05, 0.1, 0.2, 0.25]), st.floats(0.05, 0.6), st.floats(0.0, 0.2), st.integers(0, 10**6))
def test_no_point_of_a_free_cell_is_nearer_to_an_obstacle_than_the_radius(resolution, radius, clearance, seed):
    rng = np.random.default_rng(seed)
    states = rng.choice([-1, 0, 0, 0], size=(24, 24)).astype(np.int8)
    obstacles = [tuple(int(v) for v in rng.integers(0, 24, 2)) for _ in range(3)]
    for cell in obstacles:
        states[cell] = OCCUPIED
    out = inflated(states, inflation_offsets(resolution, radius, clearance))
    for cell in np.argwhere(out != OCCUPIED):
        assert all(squares_apart(tuple(cell), o, resolution) >= radius - 1e-6 for o in obstacles)
    for cell in np.argwhere(out == OCCUPIED):
        near = min(squares_apart(tuple(cell), o, resolution) for o in obstacles)
        assert near < radius + clearance, "no more is taken than must be"
    kept = out != OCCUPIED
    assert np.array_equal(out[kept], states[kept])


def test_a_part_is_inflated_as_the_whole_is():
    rng = np.random.default_rng(3)
    states = rng.choice([-1, 0, 0, 0, 0, 0, 0, 100], size=(40, 50)).astype(np.int8)
    offsets = inflation_offsets(0.1, 0.2, 0.05)
    whole = inflated(states, offsets)
    for box in ((3, 9, 30, 49), (0, 0, 0, 0), (20, 39, 0, 10)):
        assert np.array_equal(inflated(states, offsets, box), whole[box[0] : box[1] + 1, box[2] : box[3] + 1])


def lead_out(states: np.ndarray, position: tuple[float, float], radius: float = 1.2) -> np.ndarray:
    offsets = inflation_offsets(1.0, radius, 0.0)
    box = (0, states.shape[0] - 1, 0, states.shape[1] - 1)
    out = inflated(states, offsets)
    footprint(states, out, box, position, radius)
    return out


def wall_below() -> np.ndarray:
    states = np.full((12, 15), FREE, dtype=np.int8)
    states[0] = OCCUPIED
    return states


def test_a_robot_beside_a_wall_stands_free_and_sees_a_way_out():
    out = lead_out(wall_below(), (1.5, 7.5))
    assert (out[1:4, 7] == FREE).all()
    assert out[0, 4] == OCCUPIED, "the wall stays"
    assert out[1, 1] == OCCUPIED, "room beside walls elsewhere stays"


def test_a_robot_in_the_open_changes_nothing():
    assert np.array_equal(lead_out(wall_below(), (8.5, 7.5)), inflated(wall_below(), inflation_offsets(1.0, 1.2, 0.0)))


@pytest.mark.parametrize("state", [OCCUPIED, UNKNOWN])
def test_where_the_robot_stands_is_free_whatever_the_map_says(state):
    states = wall_below()
    states[4:7, 6:9] = state
    out = lead_out(states, (5.5, 7.5))
    assert out[5, 7] == FREE
    assert out[4, 7] == FREE
    assert out[4, 6] == (OCCUPIED if state == OCCUPIED else UNKNOWN), "beyond its body the map counts"


def test_the_way_out_is_not_looked_for_through_walls():
    states = np.full((15, 15), FREE, dtype=np.int8)
    states[:, 4] = OCCUPIED
    states[:, 8] = OCCUPIED
    out = lead_out(states, (7.5, 6.5))
    assert (out[:, 4] == OCCUPIED).all()
    assert (out[:, 8] == OCCUPIED).all()
    assert out[7, 6] == FREE
