import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.messages.validation import check_choices, check_observations
from common.observation import NEIGHBOUR_OFFSETS, Observation, ObservationBatch
from tests.observations import observations, random_batch, random_observation


def bit(dx: int, dy: int) -> np.uint32:
    return np.uint32(1 << [tuple(offset) for offset in NEIGHBOUR_OFFSETS.tolist()].index((dx, dy)))


def three_in_a_row(**changes) -> ObservationBatch:
    """Viewpoints at x = -1, 0, 1; the robot in the middle, each beside the next, a known target at the right one."""
    batch = ObservationBatch(
        count=np.array([3], dtype=np.int32),
        offsets=np.array([[-1, 0], [0, 0], [1, 0]], dtype=np.int16),
        utility=np.array([3, 0, 0], dtype=np.uint16),
        visited=np.array([False, True, False]),
        beacon=np.array([True, False, False]),
        edges=np.array([bit(1, 0), bit(1, 0) | bit(-1, 0), bit(-1, 0)], dtype=np.uint32),
        robot=np.array([1], dtype=np.int32),
        has_target=np.array([True]),
        target_known=np.array([True]),
        target_offset=np.array([[1.25, 0.5]], dtype=np.float32),
        link_count=np.array([2], dtype=np.int32),
        target_links=np.array([1, 2], dtype=np.uint16),
    )
    return dataclasses.replace(
        batch, **{name: np.asarray(value, getattr(batch, name).dtype) for name, value in changes.items()}
    )


@given(observations())
@settings(max_examples=100, deadline=None)
def test_valid_observations_pass(observation: Observation):
    check_observations(ObservationBatch.stack([observation, observation]), "o")


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("count", {"count": [0]}),
        ("count", {"count": [4]}),
        ("count", {"count": [-3]}),
        ("count", {"count": [20_001]}),
        ("offsets", {"offsets": [[-4001, 0], [0, 0], [1, 0]]}),
        ("offsets", {"offsets": [[-1, 0], [0, 0], [0, 32767]]}),
        ("offsets", {"offsets": [[0, 0], [-1, 0], [1, 0]]}),
        ("offsets", {"offsets": [[-1, 0], [0, 0], [0, 0]]}),
        ("offsets", {"offsets": [[-1, 1], [0, 0], [1, 0]]}),
        ("robot", {"robot": [3]}),
        ("robot", {"robot": [-1]}),
        ("robot", {"robot": [0]}),
        ("edges", {"edges": [1 << 20, 0, 0]}),
        ("edges", {"edges": [bit(1, 0), bit(1, 0), bit(-1, 0)]}),
        ("edges", {"edges": [bit(1, 0), bit(1, 0) | bit(-1, 0), 0]}),
        ("edges", {"edges": [0, bit(1, 0) | bit(-1, 0), bit(-1, 0)]}),
        ("edges", {"edges": [bit(1, 0) | bit(0, 1), bit(1, 0) | bit(-1, 0), bit(-1, 0)]}),
        ("edges", {"edges": [bit(1, 0) | bit(0, -1), bit(1, 0) | bit(-1, 0), bit(-1, 0)]}),
        ("target_known", {"has_target": [False], "target_offset": [[0, 0]]}),
        ("target_offset", {"target_offset": [[np.nan, 0]]}),
        ("target_offset", {"target_offset": [[0, np.inf]]}),
        ("target_offset", {"target_offset": [[9e3, 0]]}),
        ("target_offset", {"has_target": [False], "target_known": [False]}),
        ("link_count", {"has_target": [False], "target_known": [False], "target_offset": [[0, 0]]}),
        ("link_count", {"link_count": [21]}),
        ("link_count", {"link_count": [1]}),
        ("link_count", {"link_count": [-1]}),
        ("target_links", {"target_links": [1, 3]}),
        ("target_links", {"target_links": [1, 1]}),
    ],
)
def test_each_violation_is_named(field, changes):
    check_observations(three_in_a_row(), "o")
    with pytest.raises(MessageError) as caught:
        check_observations(three_in_a_row(**changes), "o")
    assert caught.value.field == f"o.{field}"


def ints(*values):
    return np.array(values, dtype=np.int32)


def test_choices_are_counted():
    # The robot's two neighbours and the target in sight.
    assert check_choices(three_in_a_row(), ints(0), ints(2), ints(-1), "c") == 3
    assert check_choices(three_in_a_row(target_links=[0, 2]), ints(3), ints(0), None, "c") == 2


@pytest.mark.parametrize(
    ("field", "beacon", "waypoint", "expert"),
    [
        ("beacons", 1, 0, -1),
        ("beacons", -1, 0, -1),
        ("beacons", 4, 0, -1),
        ("waypoints", 0, 1, -1),
        ("waypoints", 0, -1, -1),
        ("waypoints", 0, 4, -1),
        ("labels.beacon", 0, 0, 2),
        ("labels.beacon", 0, 0, -2),
    ],
)
def test_impossible_choices_are_named(field, beacon, waypoint, expert):
    with pytest.raises(MessageError) as caught:
        check_choices(three_in_a_row(), ints(beacon), ints(waypoint), ints(expert), "c")
    assert caught.value.field == f"c.{field}"


def test_a_target_out_of_sight_is_no_waypoint():
    with pytest.raises(MessageError, match=r"c\.waypoints"):
        check_choices(three_in_a_row(target_links=[0, 2]), ints(0), ints(3), None, "c")
    with pytest.raises(MessageError, match=r"c\.beacons"):
        check_choices(three_in_a_row(target_known=[False]), ints(3), ints(0), None, "c")


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_choices_agree_with_the_observation(seed):
    rng = np.random.default_rng(seed)
    batch = random_batch(rng, 4)
    decided = [batch[i] for i in range(4)]
    beacons = ints(*(rng.choice(o.beacon_nodes()) for o in decided))
    waypoints = ints(*(rng.choice(o.waypoint_nodes()) for o in decided))
    choices = sum(len(o.waypoint_nodes()) for o in decided)
    assert check_choices(batch, beacons, waypoints, None, "c") == choices
    node = int(rng.integers(-1, decided[2].nodes + 1))
    waypoints[2] = node
    if node in decided[2].waypoint_nodes():
        check_choices(batch, beacons, waypoints, None, "c")
    else:
        with pytest.raises(MessageError, match=f"node {node} at step 2"):
            check_choices(batch, beacons, waypoints, None, "c")


@given(observations(), st.data())
@settings(max_examples=60, deadline=None)
def test_a_flipped_edge_bit_never_passes(observation, data):
    edges = observation.edges.copy()
    edges[data.draw(st.integers(0, len(edges) - 1))] ^= np.uint32(1 << data.draw(st.integers(0, 31)))
    with pytest.raises(MessageError) as caught:
        check_observations(ObservationBatch.stack([dataclasses.replace(observation, edges=edges)]), "o")
    assert caught.value.field == "o.edges"


def test_the_largest_observation_passes():
    observation = random_observation(np.random.default_rng(0), 3)
    n = 20_000
    xs, ys = np.meshgrid(np.arange(-100, 100), np.arange(-50, 50))
    offsets = np.stack([xs.ravel(), ys.ravel()], axis=1).astype(np.int16)
    large = dataclasses.replace(
        observation,
        offsets=offsets,
        utility=np.zeros(n, np.uint16),
        visited=np.zeros(n, np.bool_),
        beacon=np.zeros(n, np.bool_),
        edges=np.zeros(n, np.uint32),
        robot=int(np.flatnonzero((offsets == 0).all(axis=1))[0]),
    )
    check_observations(ObservationBatch.stack([large]), "o")
