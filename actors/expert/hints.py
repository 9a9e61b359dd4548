"""What the true map tells beside the expert's costs: what each viewpoint would show, and what lies beyond frontiers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actors.expert.base import Expert, ExpertLabel
from actors.expert.true_graph import TrueGraph
from actors.expert.visibility import fill_words, look_from_all
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.occupancy_image import image_reaches, occupancy_image
from common.observations.observation import Observation
from common.tours import cover

BEAMS = 720


class HintingExpert:
    """An expert whose labels hold hints, for networks that learn to foresee them (`learner.algorithm.auxiliary`).

    Args:
        expert: whose labels these are.
        mapping: lattice and sensor.
    """

    def __init__(self, expert: Expert, mapping: MappingConfig) -> None:
        self._expert = expert
        self._mapping = mapping
        self._disc = math.pi * mapping.sensor_range**2

    def reset(self, world: GridMap) -> None:
        """Prepare for a world; takes about as long as the exploration expert does."""
        self._expert.reset(world)
        self._world = world
        self._graph = TrueGraph.build(world, self._mapping)
        reach = self._mapping.sensor_range / world.resolution
        self._sight = look_from_all(world.free, self._graph.points, reach, BEAMS)
        self._missing = np.zeros(self._sight.tiles, dtype=np.uint64)

    def label(
        self,
        observation: Observation,
        positions: NDArray[np.float64],
        pose: Pose,
        coverage: Coverage,
    ) -> ExpertLabel:
        """Judge the choices of one observation (see `Expert.label`), with hints."""
        label = self._expert.label(observation, positions, pose, coverage)
        nodes, _ = self._graph.match(positions)
        known = nodes >= 0
        wanted = np.zeros(len(self._graph), dtype=np.bool_)
        wanted[nodes[known]] = True
        fill_words(coverage.unseen_cells, self._world.free.shape[1], self._missing)
        sight = self._sight
        seen = cover.count_gains(sight.pointer, sight.tile, sight.mask, self._missing, wanted)
        gain = np.full(len(positions), -1.0, dtype=np.float32)
        gain[known] = seen[nodes[known]] * self._world.resolution**2 / self._disc
        x, y = positions[observation.robot]
        truth = occupancy_image(
            self._graph.mapper.belief, (float(x), float(y)), image_reaches("spacing", self._mapping)
        )
        return replace(label, gain=gain, truth=truth)
