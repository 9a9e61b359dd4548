import numpy as np
import pytest
import torch

from common.config import NetworkConfig
from common.network import padding
from common.network.attention import edge_attention, gathered_attention
from common.network.factory import make_policy_network
from common.network.graph_batch import GraphBatch
from common.network.padding import Padding
from tests.observations import random_batch


def small(variant: str = "hdplanner") -> NetworkConfig:
    return NetworkConfig(variant=variant, width=16, heads=2, layers=2, feedforward=2)


@pytest.fixture
def batch() -> GraphBatch:
    return GraphBatch.from_observations(random_batch(np.random.default_rng(3), 5), small())


def test_nodes_return_from_their_blocks(batch) -> None:
    laid = Padding.of(batch.arrays.node_ptr, batch.neighbours)
    nodes = torch.randn(len(batch.features), 7)
    blocks = laid.spread(nodes)
    assert torch.equal(laid.collect(blocks), nodes)
    assert torch.equal(laid.present.sum(1), batch.node_ptr.diff())
    assert not blocks[~laid.present].any()


def test_blocks_that_would_be_too_large_are_not_made(batch, monkeypatch) -> None:
    qkv = torch.randn(len(batch.features), 3 * 8)
    in_blocks = edge_attention(qkv, batch, 2)
    monkeypatch.setattr(padding, "MAX_PAIRS", 10)
    assert Padding.of(batch.arrays.node_ptr, batch.neighbours).edges is None
    assert torch.equal(edge_attention(qkv, batch, 2), gathered_attention(qkv, batch.neighbours, 2))
    torch.testing.assert_close(in_blocks, gathered_attention(qkv, batch.neighbours, 2))


@pytest.mark.parametrize("variant", ["hdplanner", "vanilla"])
def test_a_batch_on_another_device_goes_through_the_network(batch, variant) -> None:
    """The device `meta` has shapes but no values: what is left on the CPU by mistake fails."""
    config = small(variant)
    moved = batch.to("meta")
    output = make_policy_network(config).to("meta")(moved)
    assert output.log_waypoint.device.type == "meta" and moved.padding is not None
    assert output.log_waypoint.shape == (make_policy_network(config)(batch).log_waypoint.shape)
