"""The belief as images: what a pixel says, and where it lies."""

from __future__ import annotations

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.belief import Belief
from common.mapping.mapper import Mapper
from common.mapping.occupancy_image import REACHES, occupancy_image
from common.observations.observation import IMAGE_SIDE


def belief_of(cells: np.ndarray, resolution: float) -> Belief:
    rows, columns = cells.shape
    belief = Belief(resolution, 20.0, bounds=(0.0, 0.0, columns * resolution, rows * resolution))
    belief.padded[1:-1, 1:-1] = cells
    return belief


def test_a_pixel_tells_the_shares_of_what_it_covers():
    # Pixels of `near` are a sixteenth of the range: 1 m here, two cells.
    cells = np.full((60, 60), -1, dtype=np.int8)
    cells[30:32, 30:32] = 0
    cells[32:34, 30:32] = [[0, 100], [-1, 100]]
    image = occupancy_image(belief_of(cells, 0.5), (15.0, 15.0), (24.0, 128.0))[0].reshape(IMAGE_SIDE, IMAGE_SIDE)
    middle = IMAGE_SIDE // 2
    # The cell (30, 30) begins at (15 m, 15 m), in the middle; rows run upwards.
    assert image[middle, middle] == 15 << 4
    # A quarter free, a half occupied, in fifteenths rounded down.
    assert image[middle + 1, middle] == 3 << 4 | 7
    image[middle, middle] = image[middle + 1, middle] = 0
    assert not image.any(), "what is unknown, and what lies beyond the belief, is zero"


def test_a_turned_world_gives_a_turned_image_at_any_resolution():
    rng = np.random.default_rng(0)
    world = rng.choice(np.array([-1, 0, 100], dtype=np.int8), (20, 20))
    for fine in (1, 4):
        cells = np.kron(world, np.ones((fine, fine), dtype=np.int8))
        resolution = 2.0 / fine
        images = [
            occupancy_image(belief_of(np.rot90(cells, turn), resolution), (20.0, 20.0), (24.0, 128.0))[0].reshape(
                48, 48
            )
            for turn in range(2)
        ]
        np.testing.assert_array_equal(np.rot90(images[0]), images[1])
        if fine == 1:
            coarse = images[0]
    np.testing.assert_array_equal(images[0], coarse)


def test_the_mapper_draws_around_the_robot_when_asked():
    mapper = Mapper(MappingConfig(sensor_range=8.0, viewpoint_spacing=2.0, beacon_range=8.0), lattice_origin=(0.0, 0.0))
    ranges = np.full(72, 8.0, dtype=np.float32)
    mapper.integrate(Scan(ranges, 0.0, np.pi / 36, 8.0), Pose(10.0, 10.0))
    mapper.update(Pose(10.0, 10.0))
    assert mapper.observe().image is None
    for scale, unit in (("range", 8.0), ("spacing", 2.0)):
        images = mapper.observe(image=scale).image.reshape(2, IMAGE_SIDE, IMAGE_SIDE)
        for image, reach in zip(images, REACHES[scale], strict=True):
            shown = (image >> 4).sum() / 15 * (2 * reach * unit / IMAGE_SIDE) ** 2
            assert 0.8 < shown / mapper.belief.free_area < 1.1
