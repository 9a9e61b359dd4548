"""What the true map shows: the viewpoints of a world, and which cells each of them sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actors.expert.true_graph import TrueGraph
from actors.expert.visibility import fill_words, look_from_all
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig

BEAMS = 720


class Survey:
    """A world seen from all its viewpoints, and what a robot has not seen of it yet.

    Args:
        world: where.
        mapping: lattice and sensor.

    Attributes:
        graph: the true viewpoint graph.
        sight: which cells each of its viewpoints sees.
        missing: tile words of the cells that were unseen when `note` was called last, uint64, shape (tiles,).
    """

    def __init__(self, world: GridMap, mapping: MappingConfig) -> None:
        self.graph = TrueGraph.build(world, mapping)
        self.sight = look_from_all(world.free, self.graph.points, mapping.sensor_range / world.resolution, BEAMS)
        self.missing: NDArray[np.uint64] = np.zeros(self.sight.tiles, dtype=np.uint64)
        self._columns = world.free.shape[1]

    def note(self, coverage: Coverage) -> None:
        """Bring what is missing up to date."""
        fill_words(coverage.unseen_cells, self._columns, self.missing)
