import numpy as np
from hypothesis import given, settings

from common.observations.index import LINK_SLOT, SELF_SLOT, neighbour_table, waypoint_counts
from common.observations.observation import NEIGHBOUR_COUNT, Observation, ObservationBatch
from tests.observations import observations


def edges_of(observation: Observation) -> dict[tuple[int, int], float]:
    """Reference: the length of every way between neighbours, both ways, links of the target included."""
    steps = observation.steps
    lower = np.repeat(np.arange(observation.viewpoints), observation.degree).tolist()
    bent = dict(zip(observation.bent.tolist(), observation.bent_length.tolist(), strict=True))
    found = {}
    for edge, (i, j) in enumerate(zip(lower, observation.neighbours.tolist(), strict=True)):
        found[i, j] = bent.get(edge, np.hypot(*(steps[i] - steps[j])))
    for link in observation.target_links.tolist():
        found[link, observation.viewpoints] = np.hypot(*(steps[link] - steps[-1]))
    return found | {(j, i): length for (i, j), length in found.items()}


@given(observations(), observations())
@settings(max_examples=60, deadline=None)
def test_the_table_says_who_is_beside_whom_and_how_far(one, other):
    batch = ObservationBatch.stack([one, other, one])
    table = neighbour_table(batch)
    assert table.rows.shape == table.lengths.shape == (2 * one.nodes + other.nodes, table.rows.shape[1])
    assert table.node_ptr.tolist() == [0, one.nodes, one.nodes + other.nodes, 2 * one.nodes + other.nodes]
    widths = []
    for k, observation in enumerate((one, other, one)):
        first = int(table.node_ptr[k])
        expected = edges_of(observation)
        np.testing.assert_allclose(table.extremes[k], [min(expected.values()), max(expected.values())], rtol=1e-6)
        for i in range(observation.nodes):
            row, lengths = table.rows[first + i], table.lengths[first + i]
            assert row[SELF_SLOT] == first + i
            target = observation.viewpoints
            beside = sorted(j for a, j in expected if a == i and j < target)
            widths.append(len(beside))
            assert (row[: len(beside)] - first).tolist() == beside
            assert (row[len(beside) : SELF_SLOT] == -1).all()
            linked = i < target and (i, target) in expected
            assert row[LINK_SLOT] == (first + target if linked else -1)
            ends = [*beside, target] if linked else beside
            found = [*lengths[: len(beside)], lengths[LINK_SLOT]] if linked else lengths[: len(beside)]
            np.testing.assert_allclose(found, [expected[i, j] for j in ends], rtol=1e-6)
    assert table.rows.shape[1] == max(NEIGHBOUR_COUNT, *widths) + 2


@given(observations(), observations())
@settings(max_examples=60, deadline=None)
def test_waypoints_are_counted_as_they_are_listed(one, other):
    batch = ObservationBatch.stack([one, other, one])
    assert waypoint_counts(batch).tolist() == [len(o.waypoint_nodes()) for o in (one, other, one)]
