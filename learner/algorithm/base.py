"""What the training loop needs of the mathematics, and what it hands to the actors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from numpy.typing import NDArray

from learner.algorithm.batch import TransitionBatch

PolicyArrays = dict[str, NDArray[Any]]


class Algorithm(Protocol):
    """Networks, optimisers and the update; `learner.algorithm.factory.make_learner` makes the one of a run."""

    def update(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch; return losses and other figures by their TensorBoard names."""
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
