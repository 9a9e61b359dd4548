from __future__ import annotations

import math

import pytest
import torch

from learner.algorithm.contrastive import triplet_loss, triplets


def test_triplets_are_three_different_choices_when_they_can_be() -> None:
    owner = torch.tensor([0, 0, 0, 0, 1, 1, 2, 2, 2])
    scores = torch.tensor([0.1, 0.6, 0.2, 0.1, 0.5, 0.5, 0.2, 0.3, 0.5])
    best = torch.tensor([9.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 7.0])
    chance = torch.tensor([0.9, 0.9, 0.3, 0.4, 0.1, 0.2, 0.3, 0.8, 0.9])
    anchor, positive, negative, valid = triplets(scores, best, chance, owner, 3)
    assert valid.tolist() == [True, False, True]
    assert (anchor[0], positive[0], negative[0]) == (1, 0, 3)
    assert (anchor[2], positive[2], negative[2]) == (8, 8, 7)


def test_triplet_hinge() -> None:
    features = torch.tensor([[2.0, 0.0], [0.0, 3.0], [-1.0, 0.0]], requires_grad=True)
    index = torch.tensor
    # Unit vectors: near = sqrt 2, far = 2.
    loss = triplet_loss(features, index([0]), index([1]), index([2]), index([True]), 0.7)
    assert loss.item() == pytest.approx(math.sqrt(2) - 2 + 0.7, rel=1e-4)
    calm = triplet_loss(features, index([0]), index([1]), index([2]), index([True]), 0.5)
    assert calm.item() == 0.0
    # Anchor and positive in one: the hinge only pushes the negative away, and the gradient is finite.
    same = triplet_loss(features, index([0]), index([0]), index([1]), index([True]), 2.0)
    assert same.item() == pytest.approx(2.0 - math.sqrt(2), rel=1e-4)
    same.backward()
    assert torch.isfinite(features.grad).all()  # type: ignore[arg-type]
    nothing = triplet_loss(features, index([0]), index([1]), index([2]), index([False]), 0.7)
    assert nothing.item() == 0.0
