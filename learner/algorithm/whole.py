"""Means, sums and random numbers of a whole batch, of which this process may hold only some rows.

Several learner processes (`learner/ranks`) share each batch: every rank makes the same update from its own rows, in
lockstep. A loss that is linear in values of `mean` then has the same value on every rank, its gradients on all ranks
add up to the gradient of the whole batch (`sum_gradients`), and random numbers are those that one process would have
drawn (`drawn`). So N ranks make the weights of one, up to rounding. Outside of `sharing` the own rows are the whole.

All of these functions wait for the other ranks. A branch around them must go the same way on every rank: ask
`whole_count`, not the length of the own part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

T = TypeVar("T", bound=np.generic)


class Ranks(Protocol):
    """The processes that share each batch, of which this is one.

    Attributes:
        rank: number of this one; the rows of rank 0 come first.
        size: number of all.
    """

    rank: int
    size: int

    def sum(self, values: Tensor) -> Tensor:
        """Return the sum of a tensor over all ranks, equal on each, of its shape and type; without gradient."""
        ...


_ranks: ContextVar[Ranks | None] = ContextVar("ranks", default=None)


@contextmanager
def sharing(ranks: Ranks | None) -> Iterator[None]:
    """Let batches within be parts of one that these ranks share; None for a process that has all of it."""
    token = _ranks.set(ranks)
    try:
        yield
    finally:
        _ranks.reset(token)


def mean(values: Tensor, counts: Tensor | None = None) -> Tensor:
    """Return the mean over the whole batch, a scalar; 0 when nothing counts.

    Its gradient is that of the own rows alone.

    Args:
        values: of the own rows.
        counts: which of them count, bool, of the same shape; None for all.
    """
    own = values.sum() if counts is None else torch.where(counts, values, torch.zeros_like(values)).sum()
    ranks = _ranks.get()
    if ranks is None:
        return own / max(values.numel(), 1) if counts is None else own / counts.sum().clamp(min=1)
    number = own.new_tensor(values.numel()) if counts is None else counts.sum()
    whole, number = ranks.sum(torch.stack([own.detach().double(), number.double()])).to(own.dtype)
    return (whole + (own - own.detach())) / number.clamp(min=1)


def whole_sum(values: Tensor) -> Tensor:
    """Return the sum over all ranks, elementwise, without gradient."""
    ranks = _ranks.get()
    return values if ranks is None else ranks.sum(values)


def whole_count(own: int) -> int:
    """Return the number of items in the whole batch, of which this process has so many."""
    return sum(_counts(own)[1])


def drawn(draw: Callable[[int], NDArray[T]], own: int) -> NDArray[T]:
    """Draw random numbers for the whole batch, and return those of the own items.

    Args:
        draw: makes so many; every rank has the same generator in the same state.
        own: number of the own items.
    """
    rank, counts = _counts(own)
    first = sum(counts[:rank])
    return draw(sum(counts))[first : first + own]


def sum_gradients(parameters: Iterable[nn.Parameter]) -> None:
    """Put the gradient of the whole batch in the place of that of the own rows."""
    ranks = _ranks.get()
    if ranks is None:
        return
    held = list(parameters)
    own = [torch.zeros_like(value) if value.grad is None else value.grad for value in held]
    whole = ranks.sum(torch.cat([gradient.reshape(-1) for gradient in own]))
    for value, part in zip(held, torch.split(whole, [value.numel() for value in held]), strict=True):
        value.grad = part.view_as(value)


def _counts(own: int) -> tuple[int, list[int]]:
    """Return the number of this rank, and how many items each rank has."""
    ranks = _ranks.get()
    if ranks is None:
        return 0, [own]
    counts: Any = torch.zeros(ranks.size, dtype=torch.int64)
    counts[ranks.rank] = own
    return ranks.rank, ranks.sum(counts).tolist()
