"""The explored volume."""

import numpy as np

from deploy.mapping.volume import ExploredVolume


def add(volume: ExploredVolume, points: np.ndarray, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    volume.add(points.astype(np.float32), np.eye(3), np.zeros(3), np.array(origin), 0.0, 100.0)


def test_it_counts_voxels_of_half_a_metre_once():
    volume = ExploredVolume()
    add(volume, np.array([[0.1, 0.1, 0.1], [0.4, 0.2, 0.3], [-0.1, 0.1, 0.1], [5.0, 5.0, 5.0]]))
    assert volume.value == 3 * 0.125
    add(volume, np.array([[0.3, 0.3, 0.3], [9.9, 0.0, 0.0]]))
    assert volume.value == 4 * 0.125


def test_it_agrees_with_a_plain_count_of_many_points():
    rng = np.random.default_rng(0)
    volume = ExploredVolume()
    points = rng.uniform(-30.0, 30.0, size=(60_000, 4)).astype(np.float32)
    for part in np.array_split(points, 7):
        add(volume, part)
    near = points[np.linalg.norm(points[:, :3].astype(np.float64), axis=1) <= 100.0, :3].astype(np.float64)
    assert volume.value == len(np.unique(np.floor(near / 0.5).astype(int), axis=0)) * 0.125


def test_what_is_no_return_or_out_of_range_does_not_count():
    volume = ExploredVolume()
    volume.add(
        np.array([[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [0.1, 0.0, 0.0], [50.0, 0.0, 0.0]], dtype=np.float32),
        np.eye(3),
        np.zeros(3),
        np.zeros(3),
        0.3,
        20.0,
    )
    assert volume.value == 0.0


def test_clouds_of_a_moving_sensor_meet_in_the_map():
    volume = ExploredVolume()
    points = np.array([[4.2, 0.2, 0.2]], dtype=np.float32)
    volume.add(points, np.eye(3), np.zeros(3), np.zeros(3), 0.0, 20.0)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    place = np.array([4.2, 0.0, 0.0])
    volume.add(np.array([[0.2, 0.0, 0.2]], dtype=np.float32), turned, place, place, 0.0, 20.0)
    assert volume.value == 0.125
