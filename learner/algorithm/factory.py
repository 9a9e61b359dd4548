"""The algorithm that a run asks for."""

from __future__ import annotations

import torch

from common.config import RunConfig
from learner.algorithm.policy_learner import PolicyLearner
from learner.algorithm.ppo import PpoLearner
from learner.algorithm.sac import SacLearner


def make_learner(config: RunConfig, device: torch.device) -> PolicyLearner:
    """Return a learner of `algorithm`, with the weights of the run's seed."""
    learner = PpoLearner(config, device) if config.algorithm == "ppo" else SacLearner(config, device)
    if config.learner.compile:
        learner.compile_networks()
    return learner
