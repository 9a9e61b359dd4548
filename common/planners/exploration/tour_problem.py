"""One decision's covering tour: stops that together see what has to be seen, and the shortest way through them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.mapping.mapper import Mapper
from common.planners.exploration.sight_rows import SightRows, see_any
from common.planners.exploration.ways import Paths, Ways, place_keys
from common.tours import cover
from common.tours.local_search import improve_tour, insert_all, tour_length
from common.tours.prices import price_choices
from common.tours.sighting import Visibility, add_seen, count_bits, pack_rows, remove_seen, set_of

# Rounds in which a tour is improved, at most.
ROUNDS: Final = 6
# Tours that differ by less are equally long, metres.
TIE: Final = 0.01

_NO_STOPS: Final = np.empty(0, dtype=np.int64)


class TourProblem:
    """One decision's tour over some viewpoints, which are counted in the order of their node numbers."""

    def __init__(
        self,
        mapper: Mapper,
        paths: Paths,
        rows: SightRows,
        labels: NDArray[np.int64],
        viewpoints: NDArray[np.bool_],
        wanted: NDArray[np.bool_],
        more_viewpoints: NDArray[np.bool_],
        also_wanted: NDArray[np.bool_],
    ) -> None:
        """Collect what has to be seen, and what is worth to be seen on the way.

        Args:
            mapper: updated.
            paths: brought up to date with it.
            rows: frontier cells that each node sees from near enough.
            labels: cluster of each frontier cell, which orders the cells.
            viewpoints: nodes that may be stops, bool, shape (nodes,).
            wanted: frontier cells that must be seen from them, where they can, bool, shape (frontiers,).
            more_viewpoints: nodes that may be stops on the way.
            also_wanted: frontier cells that are worth such a stop, the wanted ones included.
        """
        robot = mapper.robot
        around = mapper.observe().waypoint_nodes()
        member = more_viewpoints & see_any(rows, also_wanted)
        member[around] = True
        member[robot] = True
        nodes = np.flatnonzero(member)
        self.ways = Ways(paths, nodes)
        self.positions = mapper.viewpoints[nodes]
        self.start, self.choices = int(np.searchsorted(nodes, robot)), np.searchsorted(nodes, around)
        self.ways.look_up(np.array([self.start]))
        reachable = np.isfinite(self.ways.lengths[self.start])
        self.allowed = viewpoints[nodes] & see_any(rows, wanted)[nodes] & reachable
        self.more = more_viewpoints[nodes] & reachable
        # Cells of a cluster, and neighbours within a row, lie near to each other.
        order = np.flatnonzero(also_wanted)
        order = order[np.argsort(labels[order], kind="stable")]
        numbers = np.full(len(labels), -1, dtype=np.int64)
        numbers[order] = np.arange(len(order))
        self.sight: Visibility = pack_rows(*rows, nodes, numbers)
        self.missing = self._seen_from(self.allowed) & set_of(numbers[wanted], self.sight.tiles)
        self.extra = self._seen_from(self.more) & ~self.missing

    def solve(self, last: list[int], detour: float) -> list[int]:
        """Return the best neighbour and the stops of the tour from there, as node numbers.

        Args:
            last: keys of the last decision's stops, in order, see `place_keys`.
            detour: metres that a stop for what need not be seen may add.
        """
        if not self.allowed.any():
            return []
        viewpoints = np.flatnonzero(self.allowed)
        places = dict(zip(place_keys(self.positions[viewpoints]).tolist(), viewpoints.tolist(), strict=True))
        kept = np.array([places[each] for each in last if each in places], dtype=np.int64)
        stops = self._cover(_NO_STOPS)
        if len(kept):
            again = self._cover(kept)
            if self._length(again) <= self._length(stops):
                stops = again
        rest = self.extra.copy()
        sight, lengths = self.sight, self.ways.lengths
        stops = cover.take_along(
            sight.pointer, sight.tile, sight.mask, rest, self.more, lengths, self.start, stops, detour
        )
        self.ways.look_up(stops)
        # What is taken along counts like the rest from here on: no other stop is left out for it.
        missing = self.missing | (self.extra & ~rest)
        if stops[0] != self.start:
            stops = self._cheapest(stops, missing)
        return [int(node) for node in self.ways.nodes[stops]]

    def _cover(self, kept: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return a short tour that covers what is missing, and begins from the order `kept`."""
        pointer, tile, mask = self.sight.pointer, self.sight.tile, self.sight.mask
        lengths = self.ways.lengths
        rest = self.missing.copy()
        remove_seen(pointer, tile, mask, kept, rest)
        gains = cover.count_gains(pointer, tile, mask, rest, self.allowed)
        chosen = cover.greedy_cover(pointer, tile, mask, rest, gains, np.ones(len(gains)), count_bits(rest), 0)
        self.ways.look_up(np.concatenate([kept, chosen]))
        stops = insert_all(lengths, self.start, kept, chosen)
        for _ in range(ROUNDS):
            before = stops
            # Stops that have moved must know their ways before the next round.
            stops = cover.improve_cover(
                pointer, tile, mask, self.missing, self.allowed, lengths, self.start, before, 0, 1
            )
            self.ways.look_up(stops)
            if np.array_equal(stops, before):
                return stops
        improve_tour(lengths, self.start, stops)
        return stops

    def _cheapest(self, stops: NDArray[np.int64], missing: NDArray[np.uint64]) -> NDArray[np.int64]:
        """Return the neighbour over which the tour is shortest, and the stops that remain from there."""
        sight, choices = self.sight, self.choices
        allowed = self.allowed | self.more
        orders = np.zeros((len(choices), len(stops)), dtype=np.int64)
        sizes = np.zeros(len(choices), dtype=np.int64)
        prices = price_choices(
            sight.pointer, sight.tile, sight.mask, missing, allowed, self.ways.lengths, stops, choices, 0, orders, sizes
        )
        legs = self.ways.lengths[self.start, choices]
        totals = legs + prices
        # The nearest of equally good ones: the more often the robot looks around, the sooner it knows better.
        best = int(np.argmin(np.where(totals <= totals.min() + TIE, legs, np.inf)))
        return np.concatenate([choices[best : best + 1], orders[best, : sizes[best]]])

    def _length(self, stops: NDArray[np.int64]) -> float:
        return float(tour_length(self.ways.lengths, self.start, stops))

    def _seen_from(self, viewpoints: NDArray[np.bool_]) -> NDArray[np.uint64]:
        words = np.zeros(self.sight.tiles, dtype=np.uint64)
        add_seen(self.sight.pointer, self.sight.tile, self.sight.mask, np.flatnonzero(viewpoints), words)
        return words
