"""The eight symmetries of the lattice: a planner's world has no up and no left, so each transition serves eight times.

Symmetry s turns by (s mod 4) quarter turns counter-clockwise, after mirroring x when s >= 4. Symmetry 0 is none. Only
positions change, and images turn with them, those of the true map too: nodes keep their numbers, and with them edges,
choices and all other labels stay as they are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from common.messages.experience import ExpertLabels
from common.observations.observation import IMAGE_SIDE, ObservationBatch
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.whole import drawn

SYMMETRIES = 8

T = TypeVar("T", np.int16, np.float32)


def _matrices() -> NDArray[np.int16]:
    quarter = np.array([[0, -1], [1, 0]])
    mirror = np.array([[-1, 0], [0, 1]])
    turns = [np.linalg.matrix_power(quarter, s % 4) for s in range(SYMMETRIES)]
    return np.stack([turn @ mirror if s >= 4 else turn for s, turn in enumerate(turns)]).astype(np.int16)


MATRICES = _matrices()
"""Matrix of each symmetry: new (dx, dy) = matrix @ (dx, dy), int16, shape (8, 2, 2)."""


def _pixels() -> NDArray[np.int64]:
    """Return from which pixel each pixel of an image comes, by symmetry, shape (8, pixels); rows run along y."""
    # Twice the place of a pixel's centre, from the image's centre, is a whole number.
    rows, columns = np.divmod(np.arange(IMAGE_SIDE**2), IMAGE_SIDE)
    places = 2 * np.stack([columns, rows]) - (IMAGE_SIDE - 1)
    source = np.empty((SYMMETRIES, IMAGE_SIDE**2), dtype=np.int64)
    for s in range(SYMMETRIES):
        x, y = (MATRICES[s] @ places + IMAGE_SIDE - 1) // 2
        source[s, y * IMAGE_SIDE + x] = np.arange(IMAGE_SIDE**2)
    return source


_SOURCES = _pixels()


def transform_observations(batch: ObservationBatch, symmetries: NDArray[np.int64]) -> ObservationBatch:
    """Apply one symmetry, 0 .. 7, to each observation; shape of ``symmetries`` (k,)."""
    matrices = MATRICES[symmetries]
    return replace(
        batch,
        offsets=_turn(np.repeat(matrices, batch.count, axis=0), batch.offsets),
        target_offset=_turn(matrices, batch.target_offset),
        image=None if batch.image is None else _turn_images(batch.image, symmetries),
    )


def augment(
    batch: TransitionBatch, rng: np.random.Generator, marks: NDArray[np.bool_] | None = None
) -> TransitionBatch:
    """Draw one symmetry for each transition and apply it to both observations; only where ``marks`` says, if given."""
    symmetries = drawn(lambda size: rng.integers(SYMMETRIES, size=size), len(batch))
    return transform_transitions(batch, symmetries if marks is None else np.where(marks, symmetries, 0))


def transform_transitions(batch: TransitionBatch, symmetries: NDArray[np.int64]) -> TransitionBatch:
    """Apply one symmetry, 0 .. 7, to each transition; shape of ``symmetries`` (k,)."""
    return replace(
        batch,
        observations=transform_observations(batch.observations, symmetries),
        next_observations=transform_observations(batch.next_observations, symmetries),
        labels=_turn_truth(batch.labels, symmetries),
        next_labels=_turn_truth(batch.next_labels, symmetries),
    )


def _turn_truth(labels: ExpertLabels | None, symmetries: NDArray[np.int64]) -> ExpertLabels | None:
    if labels is None or labels.truth is None:
        return labels
    return replace(labels, truth=_turn_images(labels.truth, symmetries))


def _turn_images(images: NDArray[np.uint8], symmetries: NDArray[np.int64]) -> NDArray[np.uint8]:
    turned: NDArray[np.uint8] = np.take_along_axis(images, _SOURCES[symmetries][:, None], axis=2)
    return turned


def _turn(matrices: NDArray[np.int16], vectors: NDArray[T]) -> NDArray[T]:
    """Multiply each vector, shape (n, 2), by its matrix, shape (n, 2, 2); exact, for the entries are -1, 0 and 1."""
    return (matrices[:, :, 0] * vectors[:, :1] + matrices[:, :, 1] * vectors[:, 1:]).astype(vectors.dtype)
