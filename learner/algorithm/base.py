"""What the training loop needs of the mathematics, and what it hands to the actors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from common.errors import HDError
from learner.algorithm.batch import TransitionBatch

PolicyArrays = dict[str, NDArray[Any]]


class NotFiniteError(Exception):
    """Nothing can be learnt from a batch: a figure or a gradient of the update is not finite.

    Attributes:
        figures: names of what is not finite.
        culprits: rows of the batch that cause it by themselves, int64; empty when it is not the data but the weights,
            so that nearly every row does, or when only several rows together do.
    """

    def __init__(self, figures: Sequence[str], culprits: NDArray[np.int64]) -> None:
        super().__init__(f"{', '.join(figures)} not finite")
        self.figures = tuple(figures)
        self.culprits = culprits


class RanksError(HDError):
    """Another of the processes that share each batch is lost, or answers no more."""


class Prepare(Protocol):
    """Does what an update does on the host before the device has work; another thread may do so during an update."""

    def __call__(self, batch: TransitionBatch, rng: np.random.Generator, *, cloning: bool) -> TransitionBatch:
        """Return a batch with its graphs.

        Args:
            batch: as drawn.
            rng: draws the symmetries.
            cloning: the update only imitates; the graphs serve no other then.
        """
        ...


class Algorithm(Protocol):
    """Networks, optimisers and the update; `learner.algorithm.factory.make_learner` makes the one of a run."""

    def update(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch; return losses and other figures by their TensorBoard names.

        Raises:
            NotFiniteError: a figure or a gradient is not finite; nothing has changed then.
        """
        ...

    def adopt(self, weights: PolicyArrays) -> None:
        """Begin with these policy weights; WeightsError when they do not fit."""
        ...

    def state(self) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
        """Return everything that resuming needs: named tensors, and plain values."""
        ...

    def restore(self, tensors: dict[str, torch.Tensor], values: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        ...

    def policy_weights(self, averaged: bool) -> PolicyArrays:
        """Return the policy's weights, or their moving average."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PublishedVersion:
    """A policy version on its way to the actors.

    Attributes:
        version: its number.
        updates: updates behind it.
        weights: what actors explore with.
        averaged: what evaluation and export use; None when averaging is off.
    """

    version: int
    updates: int
    weights: PolicyArrays
    averaged: PolicyArrays | None
