"""The belief on a raster of lattice cells: where nodes lie on it, and that it turns with the world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.observations.belief_raster import CELLS, RASTER_SIDE, SUBCELLS
from common.observations.observation import STEP_UNITS, ObservationBatch
from learner.algorithm.augment import MATRICES, SYMMETRIES, transform_observations
from tests.observations import random_batch, random_observation

CONFIG = NetworkConfig(belief_map=True)
MIDDLE = RASTER_SIDE // 2 - 1


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), symmetry=st.integers(0, SYMMETRIES - 1))
def test_the_raster_turns_with_the_world(seed: int, symmetry: int) -> None:
    batch = random_batch(np.random.default_rng(seed), 1, (2, 30), image=True)
    before = GraphArrays.from_observations(batch, CONFIG)
    after = GraphArrays.from_observations(transform_observations(batch, np.array([symmetry])), CONFIG)
    rows, columns = np.divmod(np.arange((RASTER_SIDE - 1) ** 2), RASTER_SIDE - 1)
    x, y = MATRICES[symmetry] @ (np.stack([columns, rows]) - MIDDLE) + MIDDLE
    old, new = before.raster[0][:, :, rows, columns], after.raster[0][:, :, y, x]
    np.testing.assert_allclose(new[:, 3 * SUBCELLS :], old[:, 3 * SUBCELLS :], atol=1e-5)
    for kind in range(3):
        # Subcells change places within their cell.
        part = slice(kind * SUBCELLS, (kind + 1) * SUBCELLS)
        np.testing.assert_allclose(np.sort(new[:, part], axis=1), np.sort(old[:, part], axis=1), atol=1e-6)
    inside = before.cells < CELLS
    np.testing.assert_array_equal(after.cells < CELLS, inside)
    picture, place = np.divmod(before.cells[inside], RASTER_SIDE**2)
    row, column = np.divmod(place, RASTER_SIDE)
    x, y = MATRICES[symmetry] @ (np.stack([column, row]) - MIDDLE) + MIDDLE
    np.testing.assert_array_equal(after.cells[inside], (picture * RASTER_SIDE + y) * RASTER_SIDE + x)


def test_far_viewpoints_are_found_in_the_coarser_image_and_the_farthest_in_none() -> None:
    observation = random_observation(np.random.default_rng(0), 4, lattice=True, image=True)
    steps = np.array([[0, 0], [11, -11], [12, 0], [47, 1]])
    observation = replace(observation, offsets=(steps * STEP_UNITS).astype(np.int16), robot=0)
    assert observation.image is not None
    # The pixels around the robot are free, all else is unknown: these are frontiers.
    observation.image[:] = 0
    observation.image[0].reshape(48, 48)[23:25, 23:25] = 15 << 4
    arrays = GraphArrays.from_observations(ObservationBatch.stack([observation]), CONFIG)
    near, far = MIDDLE * RASTER_SIDE + MIDDLE, RASTER_SIDE**2 + MIDDLE * RASTER_SIDE + MIDDLE
    assert arrays.cells.tolist() == [near, near - 11 * RASTER_SIDE + 11, far + 3, CELLS]
    cell = arrays.raster[0, 0, :, MIDDLE, MIDDLE]
    assert cell[:SUBCELLS].tolist() == cell[2 * SUBCELLS : 3 * SUBCELLS].tolist() == [1.0] * SUBCELLS
    assert not cell[SUBCELLS : 2 * SUBCELLS].any()
    assert cell[3 * SUBCELLS] == 1.0
    assert arrays.raster[0, 0, : 3 * SUBCELLS].sum() == 2 * SUBCELLS
