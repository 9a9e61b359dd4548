"""Places as pages and other programs are told of them: flat lists of whole centimetres, and kinds of viewpoints."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.observations.observation import Observation

PLAIN: Final = 0
"""Kind of a viewpoint that is neither visited nor useful."""
VISITED: Final = 1
"""Kind of a viewpoint where the robot was, and that observes no frontier."""
USEFUL: Final = 2
"""Kind of a viewpoint that observes frontiers."""


def viewpoint_kinds(observation: Observation) -> NDArray[np.uint8]:
    """Return the kind of each viewpoint, shape (n,)."""
    return np.where(observation.utility > 0, USEFUL, np.where(observation.visited, VISITED, PLAIN)).astype(np.uint8)


def centimetres(positions: ArrayLike, *more: ArrayLike) -> list[int]:
    """Return positions as one flat list of whole centimetres; those that are not finite are left out.

    Args:
        positions: metres, shape (n, ...); empty for none.
        more: numbers that follow each position, such as its kind, rounded; shape (n,) each.
    """
    metres = np.asarray(positions, np.float64)
    rows = np.column_stack([100.0 * metres.reshape(len(metres), math.prod(metres.shape[1:])), *more])
    flat: list[int] = np.rint(rows[np.isfinite(rows).all(axis=1)]).astype(np.int64).ravel().tolist()
    return flat
