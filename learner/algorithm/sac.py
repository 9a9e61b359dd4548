"""Hierarchical soft actor-critic with contrastive joint optimisation: one update after the other."""

from __future__ import annotations

from copy import deepcopy

import torch
from torch import Tensor, nn

from common.config import RunConfig
from common.network.policy_network import PolicyOutput
from learner.algorithm.cloning import cloning_loss
from learner.algorithm.critics import make_critic
from learner.algorithm.losses import (
    critic_loss,
    critic_target,
    entropies,
    policy_loss,
    soft_value,
    temperature_loss,
)
from learner.algorithm.optimisers import Optimiser, blend
from learner.algorithm.policy_learner import PolicyLearner, seeded
from learner.algorithm.sample import Sample
from learner.algorithm.whole import mean, whole_count


class Temperatures(nn.Module):
    """The two temperatures α_b and α_a, as logarithms."""

    def __init__(self, initial: float) -> None:
        super().__init__()
        self.log_beacon = nn.Parameter(torch.tensor(initial).log())
        self.log_waypoint = nn.Parameter(torch.tensor(initial).log())


class SacLearner(PolicyLearner):
    """Policy, twin critics, temperatures and their update.

    After imitation `sac.critic_only_updates` updates train the critics alone; all others train everything.
    """

    bootstraps = True

    def __init__(self, config: RunConfig, device: torch.device) -> None:
        with seeded(config.seed):
            super().__init__(config, device, config.sac.clip_norm)
            self.critic = make_critic(config.network).to(device)
        self.temperatures = Temperatures(config.sac.initial_temperature).to(device)
        self.target = deepcopy(self.critic).requires_grad_(False)
        self._optimisers["critic"] = Optimiser(self.critic, config.sac.clip_norm)
        self._optimisers["temperatures"] = Optimiser(self.temperatures, None)

    @property
    def stage(self) -> str:
        """What the next update does: ``cloning``, ``critic`` or ``sac``."""
        left = self.updates - self.config.cloning.updates
        if left < 0:
            return "cloning"
        return "critic" if left < self.config.sac.critic_only_updates else "sac"

    def _reinforce(self, sample: Sample, metrics: dict[str, Tensor]) -> None:
        """Train the critics, and in the last stage policy and temperatures."""
        q = self._update_critics(sample, metrics)
        if self.stage == "sac":
            output = self._update_policy(sample, q, metrics)
            self._update_temperatures(sample, output, metrics)

    def _settle(self) -> None:
        """Let the target critics follow."""
        if self.stage != "cloning":
            self._update_targets()

    def _update_critics(self, sample: Sample, metrics: dict[str, Tensor]) -> Tensor:
        """Regress both critics on the soft target; return min_i Q_i of all pairs, without gradient."""
        sac = self.config.sac
        next_value = torch.zeros_like(sample.rewards)
        if sample.after is not None:
            with torch.no_grad(), self._precision():
                after_output = self.policy(sample.after)
                next_q = torch.minimum(*self.target(sample.after, sample.told_after))
            value = soft_value(after_output, next_q, *self._alphas(), sample.after)
            next_value[sample.bootstrapped] = value
        goal = critic_target(sample.rewards, sample.terminal, next_value, sample.discounts)[sample.learnable]
        with self._precision():
            first, second = self.critic(sample.now, sample.told)
        chosen = sample.chosen[sample.learnable]
        loss = critic_loss(first[chosen], goal, sac.huber_delta) + critic_loss(second[chosen], goal, sac.huber_delta)
        metrics["gradient/critic"] = self._optimisers["critic"].prepare(loss, self._rate(self.config.adam.critic))
        metrics["loss/critic"] = loss
        if whole_count(len(chosen)):
            metrics["value/q"] = mean(first[chosen])
            metrics["value/target"] = mean(goal)
        return torch.minimum(first.detach(), second.detach())

    def _update_policy(self, sample: Sample, q: Tensor, metrics: dict[str, Tensor]) -> PolicyOutput:
        """Descend the policy loss, with the contrastive and the imitation loss beside it."""
        config = self.config
        with self._precision():
            output: PolicyOutput = self.policy(sample.now)
        loss = policy_loss(output, q, *self._alphas(), sample.now)
        metrics["loss/policy"] = loss
        if config.contrastive_weight > 0.0:
            contrast = self._contrast(sample.now, output, self._judge(sample, q))
            metrics["loss/contrastive"] = contrast
            loss = loss + config.contrastive_weight * contrast
        if config.cloning.anchor_weight > 0.0 and sample.guidance is not None:
            imitation = cloning_loss(output, sample.guidance, sample.now, config.cloning)
            metrics["loss/cloning"] = imitation.total
            metrics["cloning/expected_cost"] = imitation.expected_cost
            foreseen = self._auxiliary(output, sample.guidance, metrics)
            loss = loss + config.cloning.anchor_weight * (imitation.total + foreseen)
        self._descend(loss, self._rate(config.adam.policy), output, sample.now, metrics)
        return output

    def _judge(self, sample: Sample, q: Tensor) -> Tensor:
        """Draw whether Q or target Q judges the contrastive loss of this update, and return its values."""
        if self._rng.random() < self.config.contrastive.epsilon:
            return q
        with torch.no_grad(), self._precision():
            return torch.minimum(*self.target(sample.now, sample.told))

    def _update_temperatures(self, sample: Sample, output: PolicyOutput, metrics: dict[str, Tensor]) -> None:
        """Move both temperatures towards the target entropies."""
        if self.config.sac.learn_temperature:
            batch, fraction = sample.now, self.config.sac.target_entropy
            of_beacon, of_waypoint = entropies(output, batch)
            loss = temperature_loss(
                self.temperatures.log_beacon, of_beacon, batch.beacon_ptr.diff(), fraction
            ) + temperature_loss(self.temperatures.log_waypoint, of_waypoint, batch.waypoint_ptr.diff(), fraction)
            metrics["gradient/temperature"] = self._optimisers["temperatures"].prepare(
                loss, self.config.adam.temperature
            )
        alpha_beacon, alpha_waypoint = self._alphas()
        metrics["temperature/beacon"] = alpha_beacon
        metrics["temperature/waypoint"] = alpha_waypoint

    def _update_targets(self) -> None:
        """Copy the critics every so often, or follow them slowly."""
        sac = self.config.sac
        trained = self.updates - self.config.cloning.updates + 1
        if sac.target_update == "soft":
            blend(self.critic.parameters(), self.target.parameters(), sac.target_rate)
        elif trained % sac.target_interval == 0:
            blend(self.critic.parameters(), self.target.parameters(), 1.0)

    def _alphas(self) -> tuple[Tensor, Tensor]:
        return self.temperatures.log_beacon.detach().exp(), self.temperatures.log_waypoint.detach().exp()

    def _modules(self) -> dict[str, nn.Module]:
        return {
            **super()._modules(),
            "critic": self.critic,
            "target": self.target,
            "temperatures": self.temperatures,
        }
