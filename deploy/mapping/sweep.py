"""What a turning lidar saw while the robot moved, as if it had seen all of it from one place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

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
    first, last = float(times.min()), float(times.max())
    share = (times - first) * ((len(places) - 1) / (last - first))
    segment = np.minimum(share.astype(np.int64), len(places) - 2)
    after = (share - segment)[:, None]
    back = middle.inverse()
    # By single points of both ends of a segment: on an arc of a tenth of a radian the chord is 1 mm in a metre off.
    seen = np.stack([(back @ place).apply(points.astype(np.float64)) for place in places])
    at = np.arange(len(points))
    moved = (1.0 - after) * seen[segment, at] + after * seen[segment + 1, at]
    return np.ascontiguousarray(moved, dtype=np.float32)
