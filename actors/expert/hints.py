"""What the true map tells beside the expert's costs: what each viewpoint would show, and what lies beyond frontiers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actors.expert.base import Expert, ExpertLabel
from actors.expert.exploration import ExplorationExpert
from actors.expert.survey import Survey
from actors.maps.grid_map import GridMap
from actors.tasks.coverage import Coverage
from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.occupancy_image import image_reaches, occupancy_image
from common.observations.observation import Observation
from common.tours import cover


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
        """Prepare for a world; what the exploration expert has surveyed is not surveyed again."""
        expert = self._expert
        expert.reset(world)
        self._survey = expert.survey if isinstance(expert, ExplorationExpert) else Survey(world, self._mapping)
        self._cell_area = world.resolution**2

    def label(
        self,
        observation: Observation,
        positions: NDArray[np.float64],
        pose: Pose,
        coverage: Coverage,
    ) -> ExpertLabel:
        """Judge the choices of one observation (see `Expert.label`), with hints."""
        label = self._expert.label(observation, positions, pose, coverage)
        survey, sight = self._survey, self._survey.sight
        nodes, _ = survey.graph.match(positions)
        known = nodes >= 0
        wanted = np.zeros(len(survey.graph), dtype=np.bool_)
        wanted[nodes[known]] = True
        survey.note(coverage)
        seen = cover.count_gains(sight.pointer, sight.tile, sight.mask, survey.missing, wanted)
        gain = np.full(len(positions), -1.0, dtype=np.float32)
        gain[known] = seen[nodes[known]] * self._cell_area / self._disc
        x, y = positions[observation.robot]
        truth = occupancy_image(
            survey.graph.mapper.belief, (float(x), float(y)), image_reaches("spacing", self._mapping)
        )
        return replace(label, gain=gain, truth=truth)
