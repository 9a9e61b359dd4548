"""The feed-forward block of all transformer layers."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional


class FeedForward(nn.Module):
    """Two linear maps with a ReLU between them.

    Args:
        width: d of input and output.
        factor: hidden size as a multiple of the width.
    """

    def __init__(self, width: int, factor: int) -> None:
        super().__init__()
        self.rise = nn.Linear(width, factor * width)
        self.fall = nn.Linear(factor * width, width)

    def forward(self, inputs: Tensor) -> Tensor:
        """Map (items, d) to (items, d)."""
        return self.fall(functional.relu(self.rise(inputs), inplace=True))
