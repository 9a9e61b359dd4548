"""What a turning lidar saw while the robot moved, as if it had seen all of it from one place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from common.system.jit import njit
from deploy.tf.transform import Transform, differ


def points_at_rest(
    points: NDArray[np.float32], times: NDArray[np.float64], places: Sequence[Transform]
) -> NDArray[np.float32]:
    """Return the points of a cloud in its frame as that lay at the middle of the sweep.

    Args:
        points: float32, shape (n, 3), metres, each in the frame of its own moment.
        times: when each was measured, seconds, shape (n,).
        places: the frame in the map frame, at moments that are evenly spaced from the first point to the last.

    Returns:
        float32, shape (n, 3), metres; the same array where the frame did not move.
    """
    middle = places[len(places) // 2]
    if not any(differ(middle, place) for place in places):
        return points
    back = middle.inverse()
    moved = [back @ place for place in places]
    return _at_rest(
        points,
        times,
        np.stack([each.matrix() for each in moved]),
        np.array([each.translation for each in moved]),
    )


@njit(cache=True, nogil=True)
def _at_rest(
    points: NDArray[np.float32],
    times: NDArray[np.float64],
    rotations: NDArray[np.float64],
    offsets: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Blend where each point was by the places before and after its moment.

    On an arc of a tenth of a radian the chord is 1 mm in a metre off.
    """
    first, last = times.min(), times.max()
    segments = len(rotations) - 1
    result = np.empty((len(points), 3), np.float32)
    for n in range(len(points)):
        share = (times[n] - first) / (last - first) * segments
        segment = min(int(share), segments - 1)
        after = share - segment
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        for axis in range(3):
            value = 0.0
            for end in range(2):
                weight = after if end else 1.0 - after
                rotation = rotations[segment + end, axis]
                value += weight * (rotation[0] * x + rotation[1] * y + rotation[2] * z + offsets[segment + end, axis])
            result[n, axis] = value
    return result
