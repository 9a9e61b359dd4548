"""The policy network that a configuration asks for, in torch."""

from __future__ import annotations

from common.config import NetworkConfig
from common.network.hierarchical_network import HierarchicalNetwork
from common.network.image_network import ImageNetwork
from common.network.pointer_network import PointerNetwork
from common.network.policy_network import PolicyNetwork


def make_policy_network(config: NetworkConfig) -> PolicyNetwork:
    """Return the network of ``config.variant``, with random weights."""
    if config.variant == "cnn":
        return ImageNetwork(config)
    if config.variant in ("ariadne", "ca"):
        return PointerNetwork(config)
    return HierarchicalNetwork(config)
