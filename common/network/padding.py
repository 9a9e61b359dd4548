"""Ragged graphs in blocks of equal size, in which a GPU attends fastest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

_MULTIPLE = 8
"""Fused attention kernels read masks whose rows have a multiple of so many entries."""
MAX_PAIRS = 64_000_000
"""Pairs of places in all blocks, at most; in larger ones attention gathers the neighbours of each node instead."""


@dataclass(frozen=True, slots=True, eq=False)
class Padding:
    """Where the nodes of k observations are in blocks of n places.

    Attributes:
        shape: k and n.
        place: of each node among all places, int64, shape (nodes,).
        node: of each place, int64, shape (k n,); the number of nodes where there is none.
        present: whether a place has a node, bool, shape (k, n).
        edges: which place attends to which, bool, shape (k, 1, n, n). A place without a node attends to itself: no
            softmax is empty then. None where there would be more than `MAX_PAIRS`.
    """

    shape: tuple[int, int]
    place: Tensor
    node: Tensor
    present: Tensor
    edges: Tensor | None

    @classmethod
    def of(cls, node_ptr: NDArray[np.int64], neighbours: Tensor) -> Padding:
        """Lay nodes into blocks, on the device of ``neighbours``.

        Args:
            node_ptr: where the nodes of each observation begin, on the host, shape (k + 1,).
            neighbours: of each node, itself among them, shape (nodes, slots), -1 where absent.
        """
        counts = np.diff(node_ptr)
        k, n = len(counts), -(-int(counts.max()) // _MULTIPLE) * _MULTIPLE
        owner = np.repeat(np.arange(k), counts)
        places = np.arange(node_ptr[-1]) - node_ptr[owner] + n * owner
        nodes = np.full(k * n, node_ptr[-1])
        nodes[places] = np.arange(node_ptr[-1])
        device = neighbours.device
        place, node = torch.from_numpy(places).to(device), torch.from_numpy(nodes).to(device)
        present = (node < len(place)).view(k, n)
        edges = _edges(place, neighbours, present) if k * n * n <= MAX_PAIRS else None
        return cls((k, n), place, node, present, edges)

    def spread(self, nodes: Tensor) -> Tensor:
        """Lay values of nodes, shape (nodes, c), into their places, shape (k, n, c); zeros where there is no node."""
        return functional.pad(nodes, (0, 0, 0, 1)).index_select(0, self.node).view(*self.shape, -1)

    def collect(self, blocks: Tensor) -> Tensor:
        """Return the values of nodes, shape (nodes, c), from their places, shape (k, n, c)."""
        return blocks.reshape(self.shape[0] * self.shape[1], -1).index_select(0, self.place)


def _edges(place: Tensor, neighbours: Tensor, present: Tensor) -> Tensor:
    k, n = present.shape
    rows = neighbours.long()
    other = place.index_select(0, rows.clamp(min=0).view(-1)).view(rows.shape) % n
    # What is absent falls into one place more, which is cut off.
    index = torch.where(rows >= 0, place[:, None] * n + other, k * n * n)
    edges = torch.zeros(k * n * n + 1, dtype=torch.bool, device=place.device)
    edges[index.view(-1)] = True
    alone = torch.eye(n, dtype=torch.bool, device=place.device) & ~present[:, :, None]
    return (edges[:-1].view(k, n, n) | alone).unsqueeze(1)
