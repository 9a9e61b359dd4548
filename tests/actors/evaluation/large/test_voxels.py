import numpy as np

from actors.evaluation.large.voxels import VOXEL, VoxelMap
from actors.maps.generators import make_generator


def test_points_of_one_surface_are_counted_once_and_not_on_a_border():
    world = make_generator("building", {"width": "192", "height": "192"}).world(0)
    voxels = VoxelMap(world, 2.0)
    # A floor of 4 m x 3 m, measured again and again with an error of a hundredth of a millimetre.
    x, y = np.meshgrid(np.arange(10.2, 14.2, 0.1), np.arange(6.2, 9.2, 0.1))
    rng = np.random.default_rng(0)
    volumes = []
    for _ in range(3):
        floor = np.stack([x.ravel(), y.ravel(), rng.normal(0.0, 1e-5, x.size)], axis=1)
        voxels.add(floor)
        volumes.append(voxels.volume)
    assert volumes[0] == volumes[2]
    assert 8 * 6 * VOXEL**3 <= volumes[0] <= 9 * 7 * VOXEL**3
    # The top of a wall is inside, what lies beyond the world is not.
    voxels.add(np.array([[12.0, 8.0, 2.0], [-5.0, 8.0, 1.0], [1e6, 0.0, 0.0]]))
    assert voxels.volume == volumes[0] + VOXEL**3
