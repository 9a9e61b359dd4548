"""Attention over ragged graphs: along edges for the encoder, over all nodes of an observation for the decoders.

On the CPU compiled kernels do the work, elsewhere torch: its fused attention over padded blocks, or plain operations
over gathered neighbours where the blocks would be too large. All are equal to masked dense attention in fp32; fused
attention computes in the type that autocast says, all else in fp32.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from common.network.cross_kernels import cross_kernels
from common.network.edge_kernels import edge_kernels
from common.network.graph_batch import GraphBatch
from common.network.padding import Padding
from common.network.parallel import balanced_bounds, run_parallel


class EdgeAttention(nn.Module):
    """Multi-head self-attention of every node over itself and its neighbours (paper, section IV-B).

    Args:
        width: d.
        heads: number of heads; divides the width.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width, bias=False)
        self.out = nn.Linear(width, width)

    def forward(self, nodes: Tensor, batch: GraphBatch) -> Tensor:
        """Map node features (nodes, d) to (nodes, d)."""
        return self.out(self.mix(self.qkv(nodes), batch))

    def mix(self, qkv: Tensor, batch: GraphBatch) -> Tensor:
        """Attend with the nodes' queries, keys and values, side by side (nodes, 3 d); return (nodes, d)."""
        if qkv.device.type == "cpu":
            mixed: Tensor = _EdgeAttentionCpu.apply(qkv, batch, self.heads)  # type: ignore[no-untyped-call]
            return mixed
        return edge_attention(qkv, batch, self.heads)


class CrossAttention(nn.Module):
    """Multi-head attention of a ragged set of queries over all nodes of their observation.

    Args:
        width: d.
        heads: number of heads; divides the width.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width, bias=False)
        self.kv = nn.Linear(width, 2 * width, bias=False)
        self.out = nn.Linear(width, width)

    def forward(self, queries: Tensor, query_ptr: np.ndarray, kv: Tensor, batch: GraphBatch) -> Tensor:
        """Map queries (queries, d), grouped by observation by ``query_ptr`` (k + 1,), to (queries, d).

        ``kv`` are the nodes' keys and values, ``self.kv(nodes)``, so that several sets of queries can share them.
        """
        query = self.query(queries)
        if kv.device.type == "cpu":
            mixed: Tensor = _CrossAttentionCpu.apply(query, kv, query_ptr, batch, self.heads)  # type: ignore[no-untyped-call]
        else:
            mixed = cross_attention(query, query_ptr, kv, batch, self.heads)
        return self.out(mixed)


def edge_attention(qkv: Tensor, batch: GraphBatch, heads: int) -> Tensor:
    """Attend along edges in torch, on any device.

    Args:
        qkv: queries, keys and values side by side, shape (nodes, 3 d).
        batch: whose nodes they are.
        heads: number of heads.
    """
    padding = batch.padding or Padding.of(batch.arrays.node_ptr, batch.neighbours)
    if padding.edges is None:
        return gathered_attention(qkv, batch.neighbours, heads)
    blocks = padding.spread(qkv).view(*padding.shape, 3, heads, -1)
    query, key, value = blocks.permute(2, 0, 3, 1, 4).unbind(0)
    mixed = functional.scaled_dot_product_attention(query, key, value, padding.edges)
    return padding.collect(mixed.transpose(1, 2).flatten(2))


def gathered_attention(qkv: Tensor, neighbours: Tensor, heads: int) -> Tensor:
    """Attend along edges in plain torch, with memory that grows with the edges alone.

    Args:
        qkv: queries, keys and values side by side, shape (nodes, 3 d).
        neighbours: shape (nodes, slots), -1 where absent; every node has at least one.
        heads: number of heads.
    """
    nodes, slots = neighbours.shape
    query, key, value = qkv.float().view(nodes, 3, heads, -1).unbind(1)
    absent = neighbours < 0
    rows = neighbours.clamp(min=0).long().view(-1)
    keys = key.index_select(0, rows).view(nodes, slots, heads, -1)
    values = value.index_select(0, rows).view(nodes, slots, heads, -1)
    scores = torch.einsum("nhc,nshc->nsh", query, keys) / query.shape[-1] ** 0.5
    weights = scores.masked_fill(absent.unsqueeze(-1), -torch.inf).softmax(dim=1)
    return torch.einsum("nsh,nshc->nhc", weights, values).reshape(nodes, -1)


def cross_attention(query: Tensor, query_ptr: np.ndarray, kv: Tensor, batch: GraphBatch, heads: int) -> Tensor:
    """Attend from ragged queries over the nodes of their observation in plain torch, on any device.

    Queries and nodes are laid into padded blocks; there are few queries, so little is wasted.
    """
    k, width = len(batch), query.shape[1]
    padding = batch.padding or Padding.of(batch.arrays.node_ptr, batch.neighbours)
    per_graph = torch.from_numpy(np.diff(query_ptr)).to(query.device)
    start = torch.from_numpy(query_ptr[:-1]).to(query.device)
    owner = torch.repeat_interleave(torch.arange(k, device=query.device), per_graph, output_size=len(query))
    place = torch.arange(len(query), device=query.device) - start.index_select(0, owner)
    most_queries = int(np.diff(query_ptr).max(initial=0))
    queries = query.new_zeros((k, most_queries, width), dtype=torch.float32)
    queries = queries.index_put((owner, place), query.float())
    block = padding.spread(kv.float()).view(*padding.shape, 2, heads, -1)
    key, value = block.permute(2, 0, 3, 1, 4).unbind(0)
    mixed = functional.scaled_dot_product_attention(
        queries.view(k, most_queries, heads, -1).transpose(1, 2), key, value, padding.present[:, None, None, :]
    )
    return mixed.transpose(1, 2).reshape(k, most_queries, width)[owner, place]


class _EdgeAttentionCpu(torch.autograd.Function):
    """The compiled kernels of attention along edges."""

    @staticmethod
    def forward(ctx: Any, qkv: Tensor, batch: GraphBatch, heads: int) -> Tensor:
        ctx.dtype = qkv.dtype
        qkv = qkv.detach().float().contiguous()
        nodes, width = qkv.shape[0], qkv.shape[1] // 3
        table = batch.arrays.neighbours
        out = torch.empty((nodes, width))
        weights = torch.empty((nodes, table.shape[1], heads))
        bounds = _node_bounds(batch)
        forward, _ = edge_kernels(width // heads, heads)
        run_parallel(forward, (qkv.numpy(), table, out.numpy(), weights.numpy()), bounds)
        ctx.save_for_backward(qkv, weights)
        ctx.table, ctx.heads, ctx.bounds = table, heads, bounds
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None]:
        qkv, weights = ctx.saved_tensors
        grad = grads[0].float().contiguous()
        grad_qkv = torch.zeros_like(qkv)
        _, backward = edge_kernels(grad.shape[1] // ctx.heads, ctx.heads)
        arguments = (grad.numpy(), qkv.numpy(), ctx.table, weights.numpy(), grad_qkv.numpy())
        run_parallel(backward, arguments, ctx.bounds)
        return grad_qkv.to(ctx.dtype), None, None


class _CrossAttentionCpu(torch.autograd.Function):
    """The compiled kernels of attention over all nodes of an observation."""

    @staticmethod
    def forward(ctx: Any, query: Tensor, kv: Tensor, query_ptr: np.ndarray, batch: GraphBatch, heads: int) -> Tensor:
        ctx.dtype = kv.dtype
        query, kv = query.detach().float().contiguous(), kv.detach().float().contiguous()
        node_ptr = batch.arrays.node_ptr
        weight_ptr = np.zeros(len(query) + 1, dtype=np.int64)
        np.cumsum(np.repeat(np.diff(node_ptr) * heads, np.diff(query_ptr)), out=weight_ptr[1:])
        out = torch.empty_like(query)
        weights = torch.empty(int(weight_ptr[-1]))
        bounds = balanced_bounds(node_ptr, torch.get_num_threads())
        forward, _ = cross_kernels(query.shape[1] // heads)
        arguments = (query.numpy(), query_ptr, kv.numpy(), node_ptr, weight_ptr, out.numpy(), weights.numpy())
        run_parallel(forward, arguments, bounds)
        ctx.save_for_backward(query, kv, weights)
        ctx.query_ptr, ctx.node_ptr, ctx.weight_ptr = query_ptr, node_ptr, weight_ptr
        ctx.heads, ctx.bounds = heads, bounds
        return out

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, Tensor, None, None, None]:
        query, kv, weights = ctx.saved_tensors
        grad = grads[0].float().contiguous()
        grad_query, grad_kv = torch.zeros_like(query), torch.zeros_like(kv)
        _, backward = cross_kernels(query.shape[1] // ctx.heads)
        arguments = (
            grad.numpy(),
            query.numpy(),
            ctx.query_ptr,
            kv.numpy(),
            ctx.node_ptr,
            ctx.weight_ptr,
            weights.numpy(),
            grad_query.numpy(),
            grad_kv.numpy(),
        )
        run_parallel(backward, arguments, ctx.bounds)
        return grad_query.to(ctx.dtype), grad_kv.to(ctx.dtype), None, None, None


def _node_bounds(batch: GraphBatch) -> np.ndarray:
    """Cut the nodes at observations, one run per thread of torch."""
    node_ptr = batch.arrays.node_ptr
    return node_ptr[balanced_bounds(node_ptr, torch.get_num_threads())]
