"""Both queues of the shortest paths agree: buckets where edges are of similar length, a heap for all others."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings

from common.observations.index import neighbour_table
from common.observations.observation import Observation, ObservationBatch
from common.observations.paths import TIE, shortest_paths
from tests.observations import observations

ANY_LENGTH = np.array([0.0, np.inf])
"""What the ways of a graph may be of which nothing is known: the heap takes them all."""


@settings(max_examples=40, deadline=None)
@given(observations(120))
def test_the_queue_changes_no_bit_of_a_distance(observation: Observation) -> None:
    table = neighbour_table(ObservationBatch.stack([observation]))
    target = observation.viewpoints if observation.has_target else -1
    for sources in ([observation.robot], np.flatnonzero(observation.utility)):
        found = []
        for extremes in (table.extremes[0], ANY_LENGTH):
            distance, order = np.full(observation.nodes, np.inf), np.empty(observation.nodes, dtype=np.int64)
            distance[sources] = 0.0
            reached = shortest_paths(table.rows, table.lengths, extremes, 0, target, distance, order)
            assert sorted(order[:reached]) == np.flatnonzero(np.isfinite(distance)).tolist()
            place = np.empty(observation.nodes, dtype=np.int64)
            place[order[:reached]] = np.arange(reached)
            for j in order[:reached]:
                for i, length in zip(table.rows[j], table.lengths[j], strict=True):
                    if i in (-1, target) or length < TIE:
                        continue
                    assert abs(distance[i] + length - distance[j]) >= TIE or place[i] < place[j]
            found.append(distance)
        np.testing.assert_array_equal(found[0], found[1])
