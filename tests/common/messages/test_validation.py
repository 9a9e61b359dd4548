import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.messages.validation import check_choices, check_observations
from common.observations.index import neighbour_table
from common.observations.observation import MAX_DEGREE, STEP_UNITS, Observation, ObservationBatch
from tests.observations import observations, random_batch, random_observation


def three_in_a_row(**changes) -> ObservationBatch:
    """Viewpoints at x = -1, 0, 1; the robot in the middle, each beside the next, a known target at the right one.

    The way from the middle to the right is bent.
    """
    batch = ObservationBatch(
        count=np.array([3], dtype=np.int32),
        offsets=np.array([[-64, 0], [0, 0], [64, 0]], dtype=np.int16),
        utility=np.array([3, 0, 0], dtype=np.uint16),
        visited=np.array([False, True, False]),
        beacon=np.array([True, False, False]),
        degree=np.array([1, 1, 0], dtype=np.uint8),
        edge_count=np.array([2], dtype=np.int32),
        neighbours=np.array([1, 2], dtype=np.uint16),
        bent_count=np.array([1], dtype=np.int32),
        bent=np.array([1], dtype=np.uint32),
        bent_length=np.array([1.5], dtype=np.float32),
        robot=np.array([1], dtype=np.int32),
        has_target=np.array([True]),
        target_known=np.array([True]),
        target_offset=np.array([[1.25, 0.5]], dtype=np.float32),
        link_count=np.array([2], dtype=np.int32),
        target_links=np.array([1, 2], dtype=np.uint16),
        cell=np.array([0.0625], dtype=np.float32),
        reach=np.array([5.0], dtype=np.float32),
        route_count=np.array([2], dtype=np.int32),
        route=np.array([0, 2], dtype=np.uint16),
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
        ("offsets", {"offsets": [[-32_001, 0], [0, 0], [64, 0]]}),
        ("offsets", {"offsets": [[-64, 0], [0, 0], [0, 32_767]]}),
        ("offsets", {"offsets": [[-64, 0], [0, 0], [0, -32_768]]}),
        ("robot", {"robot": [3]}),
        ("robot", {"robot": [-1]}),
        ("robot", {"robot": [0]}),
        ("edge_count", {"edge_count": [1]}),
        ("edge_count", {"edge_count": [-2]}),
        ("edge_count", {"degree": [1, 0, 0]}),
        ("edge_count", {"degree": [1, 255, 0]}),
        ("neighbours", {"neighbours": [1, 3]}),
        ("neighbours", {"neighbours": [1, 65_535]}),
        ("neighbours", {"neighbours": [1, 1]}),
        ("neighbours", {"neighbours": [1, 0]}),
        ("neighbours", {"neighbours": [0, 2]}),
        ("neighbours", {"degree": [2, 0, 0], "neighbours": [1, 1]}),
        ("neighbours", {"degree": [2, 0, 0], "neighbours": [2, 1]}),
        ("neighbours", {"degree": [1, 0, 1]}),
        ("bent_count", {"bent_count": [0]}),
        ("bent_count", {"bent_count": [-1]}),
        ("bent", {"bent": [2]}),
        ("bent", {"bent": [2**32 - 1]}),
        ("bent", {"bent_count": [2], "bent": [1, 1], "bent_length": [1.5, 1.5]}),
        ("bent", {"bent_count": [2], "bent": [1, 0], "bent_length": [1.5, 1.5]}),
        ("bent_length", {"bent_length": [np.nan]}),
        ("bent_length", {"bent_length": [np.inf]}),
        ("bent_length", {"bent_length": [0.0]}),
        ("bent_length", {"bent_length": [-1.0]}),
        ("bent_length", {"bent_length": [0.95]}),
        ("bent_length", {"bent_length": [1000.5]}),
        ("target_known", {"has_target": [False], "target_offset": [[0, 0]]}),
        ("target_offset", {"target_offset": [[np.nan, 0]]}),
        ("target_offset", {"target_offset": [[0, np.inf]]}),
        ("target_offset", {"target_offset": [[1001, 0]]}),
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
def test_spoilt_edges_never_crash_what_reads_them(observation, data):
    """Whatever passes can be read; a mistake shows as an error of the field that was spoilt or one that it implies."""
    name = data.draw(st.sampled_from(["degree", "neighbours", "bent", "bent_length"]))
    spoilt = getattr(observation, name).copy()
    if len(spoilt) == 0:
        return
    bits = spoilt.view(f"u{spoilt.itemsize}")
    bits[data.draw(st.integers(0, len(bits) - 1))] ^= bits.dtype.type(
        1 << data.draw(st.integers(0, 8 * spoilt.itemsize - 1))
    )
    batch = ObservationBatch.stack([dataclasses.replace(observation, **{name: spoilt})])
    try:
        check_observations(batch, "o")
    except MessageError as error:
        related = {"o.degree", "o.edge_count", "o.neighbours", "o.bent", "o.bent_length"}
        assert error.field in related
    else:
        assert name != "degree"
        table = neighbour_table(batch)
        beside = table.rows[:, :-2]
        assert beside.max() < observation.nodes
        present = beside >= 0
        assert (np.diff(beside, axis=1)[present[:, 1:]] > 0).all()


def a_hub(neighbours: int) -> ObservationBatch:
    """One viewpoint in the middle of the numbers with lower and higher neighbours, the robot there."""
    n = neighbours + 1
    middle = n // 2
    degree = np.zeros(n, dtype=np.uint8)
    degree[:middle] = 1
    degree[middle] = n - middle - 1
    observation = random_observation(np.random.default_rng(0), n)
    return ObservationBatch.stack(
        [
            dataclasses.replace(
                observation,
                offsets=np.zeros((n, 2), dtype=np.int16),
                degree=degree,
                neighbours=np.concatenate([np.full(middle, middle), np.arange(middle + 1, n)]).astype(np.uint16),
                bent=np.zeros(0, dtype=np.uint32),
                bent_length=np.zeros(0, dtype=np.float32),
            )
        ]
    )


def test_a_viewpoint_has_a_bounded_number_of_neighbours():
    check_observations(a_hub(MAX_DEGREE), "o")
    with pytest.raises(MessageError, match=r"o\.neighbours: .* 255 neighbours .*viewpoint 128 has more"):
        check_observations(a_hub(MAX_DEGREE + 1), "o")


def test_the_largest_observation_passes():
    observation = random_observation(np.random.default_rng(0), 3)
    n = 20_000
    xs, ys = np.meshgrid(np.arange(-100, 100), np.arange(-50, 50))
    offsets = (STEP_UNITS * np.stack([xs.ravel(), ys.ravel()], axis=1)).astype(np.int16)
    degree = np.ones(n, np.uint8)
    degree[-1] = 0
    large = dataclasses.replace(
        observation,
        offsets=offsets,
        utility=np.zeros(n, np.uint16),
        visited=np.zeros(n, np.bool_),
        beacon=np.zeros(n, np.bool_),
        degree=degree,
        neighbours=np.arange(1, n, dtype=np.uint16),
        bent=np.zeros(0, np.uint32),
        bent_length=np.zeros(0, np.float32),
        robot=int(np.flatnonzero((offsets == 0).all(axis=1))[0]),
    )
    check_observations(ObservationBatch.stack([large]), "o")
