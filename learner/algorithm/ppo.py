"""Proximal policy optimisation on top of the exact sum of the expert's detours.

The privileged expert tells the detour c(a) of every waypoint, which is minus the next reward. Its expectation
Σ_a π(a) c(a) is summed exactly by the imitation loss, without noise of sampling. What is left to learn from returns is
what the expert does not know: what the policy will make of the state that it comes to.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from common.config import RunConfig
from common.network.segment import segment_sum
from learner.algorithm.augment import augment
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.cloning import cloning_loss
from learner.algorithm.losses import clipped_surrogate, critic_loss, log_marginal
from learner.algorithm.optimisers import Optimiser
from learner.algorithm.policy_learner import PolicyLearner, seeded
from learner.algorithm.returns import Returns
from learner.algorithm.sample import Sample, largest_told, told_rewards
from learner.algorithm.value import FamilyScales, ValueNetwork
from learner.algorithm.whole import mean, whole_count


class PpoLearner(PolicyLearner):
    """Policy, value function, the sizes of advantages, and their update.

    After imitation `ppo.value_only_updates` updates train the value function alone; all others descend

        mean [Σ_a π(a) c(a) / σ − min(ρ A', clip(ρ) A')] + ppo.imitation_weight · imitation loss,

    where π is the marginal of the waypoints, ρ = π(a_t) / π_behaviour(a_t), and A' = (A + c(a_t) − Σ_a π(a) c(a)) / σ,
    with A = R_n + γ^m V(s') − V(s), is the advantage without the part that the exact sum has already. A' counts from
    the running mean of its family of worlds, which costs no bias and forgives a value function that lags behind; σ is
    the standard deviation there, so that every family counts alike.
    """

    def __init__(self, config: RunConfig, device: torch.device) -> None:
        with seeded(config.seed):
            super().__init__(config, device, config.ppo.clip_norm)
            self.value = ValueNetwork().to(device)
        self.scales = FamilyScales(config.ppo.scale_rate).to(device)
        self._optimisers["value"] = Optimiser(self.value, config.ppo.clip_norm)

    @property
    def stage(self) -> str:
        """What the next update does: ``cloning``, ``value`` or ``ppo``."""
        left = self.updates - self.config.cloning.updates
        if left < 0:
            return "cloning"
        return "value" if left < self.config.ppo.value_only_updates else "ppo"

    def _augmented(self, batch: TransitionBatch, rng: np.random.Generator) -> TransitionBatch:
        """Turn only what serves imitation: ratios compare policies on what the older one saw."""
        return augment(batch, rng, batch.probabilities == 0.0)

    def _reinforce(self, sample: Sample, metrics: dict[str, Tensor]) -> None:
        """Train the value function, and in the last stage the policy."""
        returns = Returns.make(sample.batch, sample.now.arrays, self.config, self.device)
        advantage = self._update_value(returns, metrics)
        if self.stage == "ppo":
            self._update_policy(sample, returns, advantage, metrics)

    def _settle(self) -> None:
        """Leave all as it is: nothing follows the value function."""

    def _update_value(self, returns: Returns, metrics: dict[str, Tensor]) -> Tensor:
        """Regress V(s) on R_n + γ^m V(s'); return their difference A before the step, shape (n,)."""
        value = self.value(returns.now)
        with torch.no_grad():
            goal = returns.rewards + returns.discounts * self.value(returns.after)
            advantage = goal - value
        if whole_count(len(returns)):
            loss = critic_loss(value, goal, self.config.ppo.huber_delta)
            metrics["gradient/value"] = self._optimisers["value"].prepare(loss, self.config.ppo.value)
            metrics["loss/value"] = loss
            metrics["value/v"] = mean(value)
            metrics["value/target"] = mean(goal)
            variance = mean((goal - metrics["value/target"]).square())
            metrics["value/explained"] = 1.0 - mean(advantage.square()) / variance.clamp(min=1e-6)
        return advantage

    def _update_policy(self, sample: Sample, returns: Returns, advantage: Tensor, metrics: dict[str, Tensor]) -> None:
        """Descend the imitation loss with the clipped loss, and the contrastive one, beside it."""
        config, batch = self.config, sample.now
        assert sample.guidance is not None, "returns come from labelled transitions"
        with self._precision():
            output = self.policy(batch)
        imitation = cloning_loss(output, sample.guidance, batch, config.cloning)
        metrics["loss/cloning"] = imitation.total
        metrics["cloning/expected_cost"] = imitation.expected_cost
        foreseen = self._auxiliary(output, sample.guidance, metrics)
        loss = config.ppo.imitation_weight * (imitation.total + foreseen)
        detour = -told_rewards(sample.guidance.cost, config)
        log_waypoint = log_marginal(output, batch)
        expected = segment_sum(log_waypoint.exp() * detour, batch.waypoint_graph, len(batch))[returns.rows]
        rest, size = self._rest(returns, advantage + detour[returns.slot] - expected.detach(), metrics)
        if whole_count(len(returns)):
            log_ratio = log_waypoint[returns.slot] - returns.probability.log()
            surrogate = clipped_surrogate(log_ratio, rest / size, config.ppo.clip)
            exact = mean(expected / size)
            loss = loss + exact + surrogate
            metrics["loss/exact"] = exact
            ratio = log_ratio.detach().exp()
            metrics["loss/surrogate"] = surrogate
            metrics["policy/clipped"] = mean(((ratio - 1.0).abs() > config.ppo.clip).float())
            metrics["policy/divergence"] = mean(ratio - 1.0 - log_ratio.detach())
        if config.contrastive_weight > 0.0:
            contrast = self._contrast(batch, output, self._judge(detour, returns, rest)[batch.pair_waypoint])
            metrics["loss/contrastive"] = contrast
            loss = loss + config.contrastive_weight * contrast
        metrics["loss/policy"] = loss
        self._descend(loss, self._rate(config.adam.policy), output, batch, metrics)

    def _rest(self, returns: Returns, rest: Tensor, metrics: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Take note of A', and return it less the mean of its family, bounded, with that family's standard deviation.

        Both in units of reward, shape (n,); the bound is `ppo.max_advantage` standard deviations.
        """
        # A state that the expert calls a dead end moves its potential by a kilometre: bounded as its detours are.
        bound = largest_told(self.config)
        rest = rest.clamp(-bound, bound)
        count = self.scales.add(rest, returns.family)
        usual, size = self.scales.usual()
        if whole_count(len(returns)):
            metrics["advantage/rest"] = mean(rest)
            for family in count.nonzero()[:, 0].tolist():
                metrics[f"advantage/size_{family}"] = size[family]
        unit = size[returns.family]
        most = self.config.ppo.max_advantage * unit
        return torch.minimum(torch.maximum(rest - usual[returns.family], -most), most), unit

    def _judge(self, detour: Tensor, returns: Returns, rest: Tensor) -> Tensor:
        """Return what plays the part of Q in the contrastive loss, by waypoint slot: −c, with A' where it is known.

        Up to a constant of each state Q(a) is −c(a) + A'(a), and A' is known of the waypoint that was taken. Whether it
        is added is drawn once an update, as Algorithm 2 draws between Q and target Q.
        """
        if self._rng.random() < self.config.contrastive.epsilon:
            return (-detour).index_add(0, returns.slot, rest)
        return -detour

    def _modules(self) -> dict[str, nn.Module]:
        return {**super()._modules(), "value": self.value, "scales": self.scales}
