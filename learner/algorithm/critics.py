"""The critics that a network configuration asks for."""

from __future__ import annotations

from common.config import NetworkConfig
from learner.algorithm.baseline_critics import ImageCritic, PointerCritic
from learner.algorithm.critic import Critic, HierarchicalCritic


def make_critic(config: NetworkConfig) -> Critic:
    """Return the twin critics of ``config.variant``, with random weights."""
    if config.variant == "cnn":
        return ImageCritic(config)
    if config.variant in ("ariadne", "ca"):
        return PointerCritic(config)
    return HierarchicalCritic(config)
