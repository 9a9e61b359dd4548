"""The value of a state for on-policy returns: a small network on a few privileged numbers, not on the graph."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.config import RunConfig
from common.messages.experience import ExpertLabels
from common.observations.index import waypoint_counts
from common.observations.observation import ObservationBatch
from learner.algorithm.whole import whole_sum

VALUE_FEATURES = 16
_HIDDEN = 64


class ValueNetwork(nn.Module):
    """V(s), the discounted sum of rewards that the policy still earns; 0 everywhere at the start."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(VALUE_FEATURES, _HIDDEN), nn.Tanh(), nn.Linear(_HIDDEN, _HIDDEN), nn.Tanh(), nn.Linear(_HIDDEN, 1)
        )
        nn.init.zeros_(self.layers[-1].weight)  # type: ignore[arg-type]
        nn.init.zeros_(self.layers[-1].bias)  # type: ignore[arg-type]

    def forward(self, features: Tensor) -> Tensor:
        """Return V for features of shape (k, `VALUE_FEATURES`): shape (k,)."""
        value: Tensor = self.layers(features).squeeze(1)
        return value


def value_features(observations: ObservationBatch, labels: ExpertLabels, config: RunConfig) -> NDArray[np.float32]:
    """Describe k labelled states by numbers from 0 to 1, float32, shape (k, `VALUE_FEATURES`).

    How much is left (the expert's distance, unseen area, frontiers, beacons), how wide the known world is and how
    much of it was visited, how much hangs on the choice (the expert's detours), and where a target is.

    Args:
        observations: what the policy sees.
        labels: of all of them.
        config: units and bounds of the detours.
    """
    k = len(observations)
    graph = np.repeat(np.arange(k), observations.count)

    def total(values: NDArray[np.generic]) -> NDArray[np.float64]:
        return np.bincount(graph, weights=values, minlength=k).astype(np.float64, copy=False)

    viewpoints = np.maximum(observations.count, 1)
    useful = total(observations.utility > 0)
    frontier = total(np.log1p(observations.utility.astype(np.float64)))
    distance = labels.remaining.astype(np.float64) / config.reward.potential_scale
    second, mean, worst = _spread(labels.cost, waypoint_counts(observations), config)
    to_target = np.hypot(*observations.target_offset.T.astype(np.float64))
    columns = (
        distance / (distance + 50.0),
        np.log1p(distance) / 8.0,
        np.log1p(labels.unseen.astype(np.float64)) / 10.0,
        np.log1p(total(observations.beacon)) / 5.0,
        np.log1p(useful) / 8.0,
        np.log1p(frontier) / 9.0,
        frontier / np.maximum(useful, 1.0) / 6.0,
        np.log1p(viewpoints) / 8.0,
        total(observations.visited) / viewpoints,
        2.0 * observations.edge_count / viewpoints / 24.0,
        second,
        mean,
        worst,
        observations.has_target.astype(np.float64),
        observations.target_known.astype(np.float64),
        np.log1p(to_target) / 5.0,
    )
    return np.clip(np.stack(columns, axis=1), 0.0, 1.0).astype(np.float32)


def _spread(
    cost: NDArray[np.float32], choices: NDArray[np.int32], config: RunConfig
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return second smallest, mean and largest detour of every state, as shares of `cloning.max_cost`; 0 without."""
    k = len(choices)
    owner = np.repeat(np.arange(k), choices)
    shares = np.minimum(cost / (config.cloning.cost_scale * config.cloning.max_cost), 1.0).astype(np.float64)
    ascending = shares[np.lexsort((shares, owner))]
    first = np.cumsum(choices) - choices
    second, worst = np.zeros(k), np.zeros(k)
    several, some = choices > 1, choices > 0
    second[several] = ascending[first[several] + 1]
    worst[some] = ascending[(first + choices - 1)[some]]
    return second, np.bincount(owner, weights=shares, minlength=k) / np.maximum(choices, 1), worst


class FamilyScales(nn.Module):
    """What advantages usually are in each family of worlds: running mean and standard deviation, in units of reward."""

    LEAST = 0.1
    """No family counts as quieter than this."""

    def __init__(self, rate: float, families: int = 256) -> None:
        super().__init__()
        self._rate = rate
        self.weight: Tensor
        self.total: Tensor
        self.square: Tensor
        for name in ("weight", "total", "square"):
            self.register_buffer(name, torch.zeros(families))

    def add(self, advantages: Tensor, families: Tensor) -> Tensor:
        """Take note of new advantages, shape (n,), and of their families, int64, shape (n,).

        Return how many are new in each family, shape (families,).
        """
        count = self._sums(torch.ones_like(advantages), families)
        kept = (1.0 - self._rate) ** count
        share = (1.0 - kept) / count.clamp(min=1.0)
        self.weight.mul_(kept).add_(1.0 - kept)
        self.total.mul_(kept).add_(share * self._sums(advantages, families))
        self.square.mul_(kept).add_(share * self._sums(advantages.square(), families))
        return count

    def usual(self) -> tuple[Tensor, Tensor]:
        """Return mean and standard deviation of every family, shape (families,); 0 and `LEAST` where none was seen."""
        weight = self.weight.clamp(min=1e-12)
        mean = self.total / weight
        variance = (self.square / weight - mean.square()).clamp(min=0.0)
        return mean, variance.sqrt().clamp(min=self.LEAST)

    def _sums(self, values: Tensor, families: Tensor) -> Tensor:
        return whole_sum(torch.zeros_like(self.weight).index_add_(0, families, values))
