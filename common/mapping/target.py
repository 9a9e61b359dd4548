"""The navigation target as a node of the graph: tied to viewpoints in line once it is known, to beacons until then."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.mapping.beacons import nearest_in_line
from common.mapping.belief import Belief
from common.mapping.raycast import SUBCELLS
from common.mapping.sight import FREE
from common.mapping.viewpoints import LONGEST_EDGE, ViewpointGraph
from common.mapping.ways import length_of
from common.observations.observation import MAX_TARGET_LINKS

_NO_LINKS: Final = np.empty(0, dtype=np.int64)


class Target:
    """Where the robot must go in navigation.

    Attributes:
        position: (x, y), metres.
        known: its cell is known to be free, and at least one viewpoint is tied to it.
        links: nodes that are tied to it, ascending, int64, shape (m,), m <= 20.
        lengths: of the ways from them, metres; of an unknown target as the crow flies.
    """

    def __init__(self, position: tuple[float, float], config: MappingConfig) -> None:
        self.position = position
        self._resolution = config.resolution
        self._spacing = config.viewpoint_spacing
        # One subcell of rounding must not cut off a viewpoint that is exactly as far as edges reach.
        self._reach = int(LONGEST_EDGE * config.viewpoint_spacing / config.resolution * SUBCELLS) + 2
        self.forget()

    def forget(self) -> None:
        """Be unknown and tied to nothing."""
        self.known = False
        self.links = _NO_LINKS
        self.lengths = np.empty(0)
        self._piece = -1

    def offset(self, robot: tuple[float, float]) -> NDArray[np.float32]:
        """Return where the target lies from the robot's viewpoint, lattice steps, float32, shape (2,)."""
        x, y = self.position
        return np.array([(x - robot[0]) / self._spacing, (y - robot[1]) / self._spacing], dtype=np.float32)

    def tie(
        self,
        belief: Belief,
        graph: ViewpointGraph,
        numbers: NDArray[np.int32],
        x: NDArray[np.int64],
        y: NDArray[np.int64],
        beacon: NDArray[np.bool_],
    ) -> None:
        """Link the target with the viewpoints in a clear line, else with that of its piece, else with the beacons.

        Args:
            belief: what is known.
            graph: brought up to date.
            numbers: node number of each piece, -1 without one.
            x: of the nodes, subcells.
            y: likewise.
            beacon: flags of the nodes.
        """
        self.forget()
        here = belief.subcells(self.position)
        if belief.at(self.position) == FREE:
            cells = graph.cells
            self.links = nearest_in_line(cells.clear, cells.width, x, y, *here, self._reach, MAX_TARGET_LINKS)
            if not len(self.links):
                piece = graph.piece_of(here)
                if piece >= 0 and numbers[piece] >= 0:
                    self._piece = piece
                    self.links = np.array([numbers[piece]], dtype=np.int64)
        self.known = len(self.links) > 0
        if not self.known:
            beacons = np.flatnonzero(beacon)
            # Whole numbers would overflow for a target some kilometres away.
            far = (x[beacons] - here[0]).astype(np.float64) ** 2 + (y[beacons] - here[1]).astype(np.float64) ** 2
            self.links = np.sort(beacons[np.argsort(far, kind="stable")[:MAX_TARGET_LINKS]])
        away = np.hypot((x[self.links] - here[0]).astype(np.float64), (y[self.links] - here[1]).astype(np.float64))
        if self._piece >= 0:
            away = np.array([length_of(self._inside(graph, here))])
        self.lengths = away / SUBCELLS * self._resolution
        self._here = here

    def way(self, graph: ViewpointGraph, piece: int) -> NDArray[np.int64]:
        """Return the corners of the way from the viewpoint of a linked piece to the target, subcells, ends included."""
        if piece == self._piece:
            return self._inside(graph, self._here)
        p = graph.pieces[piece]
        return np.array([(p["x"], p["y"]), self._here], dtype=np.int64)

    def _inside(self, graph: ViewpointGraph, here: tuple[int, int]) -> NDArray[np.int64]:
        p = graph.pieces[self._piece]
        return graph.way_within(self._piece, (int(p["x"]), int(p["y"])), here)
