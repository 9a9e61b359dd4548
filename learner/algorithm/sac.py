"""Hierarchical soft actor-critic with contrastive joint optimisation: one update after the other."""

from __future__ import annotations

from contextlib import AbstractContextManager
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.config.schema import RunConfig
from common.errors import CheckpointError
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyNetwork, PolicyOutput
from common.network.segment import segment_sum
from common.network.state import load_arrays, to_arrays
from learner.algorithm.augment import augment
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.cloning import cloning_loss
from learner.algorithm.critic import HierarchicalCritic
from learner.algorithm.device import wants_bf16
from learner.algorithm.losses import (
    critic_loss,
    critic_target,
    entropies,
    policy_loss,
    soft_value,
    temperature_loss,
    triplet_loss,
    triplets,
    waypoint_marginal,
)
from learner.algorithm.optimisers import Optimiser, blend, scheduled_rate
from learner.algorithm.sample import Sample


class Temperatures(nn.Module):
    """The two temperatures α_b and α_a, as logarithms."""

    def __init__(self, initial: float) -> None:
        super().__init__()
        self.log_beacon = nn.Parameter(torch.tensor(initial).log())
        self.log_waypoint = nn.Parameter(torch.tensor(initial).log())


class SacLearner:
    """Networks, optimisers and the update.

    The first `cloning.updates` updates imitate the expert; the next `sac.critic_only_updates` train the critics alone;
    all others train everything. The same seed and batches give the same weights on the CPU.

    Usage::

        learner = SacLearner(config, torch.device("cpu"))
        metrics = learner.update(replay.sample())
        weights = learner.policy_weights(averaged=False)

    Attributes:
        updates: updates done.
        device: where the networks are.
    """

    def __init__(self, config: RunConfig, device: torch.device) -> None:
        self.config = config
        self.device = device
        self.updates = 0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.policy = PolicyNetwork(config.network).to(device)
            self.critic = HierarchicalCritic(config.network).to(device)
        self.temperatures = Temperatures(config.sac.initial_temperature).to(device)
        self.target = deepcopy(self.critic).requires_grad_(False)
        self.average = deepcopy(self.policy).requires_grad_(False)
        self._optimisers = {
            "policy": Optimiser(self.policy, config.sac.clip_norm),
            "critic": Optimiser(self.critic, config.sac.clip_norm),
            "temperatures": Optimiser(self.temperatures, None),
        }
        self._rng = np.random.default_rng(config.seed)
        self._autocast = wants_bf16(config.learner.precision, device)

    @property
    def stage(self) -> str:
        """What the next update does: ``cloning``, ``critic`` or ``sac``."""
        left = self.updates - self.config.cloning.updates
        if left < 0:
            return "cloning"
        return "critic" if left < self.config.sac.critic_only_updates else "sac"

    def update(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch; return the update's metrics by their TensorBoard names.

        Raises:
            ValueError: a chosen node is no beacon or waypoint of its observation.
        """
        if self.config.learner.augment:
            batch = augment(batch, self._rng)
        stage = self.stage
        sample = Sample.make(batch, self.config, self.device, bootstrap=stage != "cloning")
        metrics: dict[str, Tensor] = {}
        if stage == "cloning":
            self._imitate(sample, metrics)
        else:
            q = self._update_critics(sample, metrics)
            if stage == "sac":
                output = self._update_policy(sample, q, metrics)
                self._update_temperatures(sample, output, metrics)
            self._update_targets()
        self._update_average(stage)
        self.updates += 1
        return _to_floats(metrics)

    def adopt(self, weights: dict[str, NDArray[np.float32]]) -> None:
        """Begin with these policy weights; the critics stay as they are.

        Raises:
            WeightsError: a weight is missing, unknown, of another shape or type, or not finite; the error names it.
        """
        load_arrays(self.policy, weights)
        load_arrays(self.average, weights)

    def policy_weights(self, averaged: bool) -> dict[str, NDArray[np.float32]]:
        """Copy the policy's weights to the host: the moving average of them, or the newest."""
        return to_arrays(self.average if averaged and self.config.learner.average_decay > 0 else self.policy)

    def state(self) -> tuple[dict[str, Tensor], dict[str, Any]]:
        """Return everything that exact resumption needs: named tensors, and values that JSON can hold."""
        tensors: dict[str, Tensor] = {}
        for module, values in self._modules().items():
            for name, value in values.state_dict().items():
                tensors[f"{module}/{name}"] = value.detach().cpu().clone().contiguous()
        moments: dict[str, int] = {}
        for optimiser, adam in self._optimisers.items():
            held = adam.state()
            moments[optimiser] = len(held)
            tensors.update({f"optimiser.{optimiser}/{name}": value for name, value in held.items()})
        return tensors, {"updates": self.updates, "random": self._rng.bit_generator.state, "moments": moments}

    def restore(self, tensors: dict[str, Tensor], values: dict[str, Any]) -> None:
        """Continue from a `state`.

        Raises:
            CheckpointError: the state lacks something.
            WeightsError: a weight does not fit this configuration; the error names it.
        """
        groups: dict[str, dict[str, Tensor]] = {}
        for full_name, value in tensors.items():
            group, _, name = full_name.partition("/")
            groups.setdefault(group, {})[name] = value
        missing = (set(self._modules()) - set(groups)) | ({"updates", "random", "moments"} - set(values))
        for optimiser, count in values.get("moments", {}).items():
            if len(groups.get(f"optimiser.{optimiser}", {})) != count:
                missing.add(f"optimiser.{optimiser}")
        if missing:
            raise CheckpointError(
                f"the learner's state lacks all or part of {sorted(missing)}: use an older checkpoint"
            )
        for module, held in self._modules().items():
            load_arrays(held, {name: value.numpy() for name, value in groups[module].items()})
        for optimiser, adam in self._optimisers.items():
            adam.restore(groups.get(f"optimiser.{optimiser}", {}))
        self.updates = int(values["updates"])
        self._rng.bit_generator.state = values["random"]

    def _imitate(self, sample: Sample, metrics: dict[str, Tensor]) -> None:
        """Descend the imitation loss; a batch without labels changes nothing."""
        if sample.guidance is None:
            return
        with self._precision():
            output = self.policy(sample.now)
        loss = cloning_loss(output, sample.guidance, sample.now, self.config.cloning)
        rate = scheduled_rate(
            self.config.cloning.learning_rate,
            self.updates,
            self.config.learner.total_updates,
            self.config.adam.model_copy(update={"schedule": "constant"}),
        )
        metrics["gradient/policy"] = self._optimisers["policy"].step(loss.total, rate)
        metrics["loss/cloning"] = loss.total
        metrics["cloning/expected_cost"] = loss.expected_cost
        metrics["cloning/cross_entropy"] = loss.cross_entropy
        metrics["cloning/beacon_cross_entropy"] = loss.beacon_cross_entropy
        self._note_entropies(output, sample.now, metrics)

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
        metrics["gradient/critic"] = self._optimisers["critic"].step(loss, self._rate(self.config.adam.critic))
        metrics["loss/critic"] = loss
        metrics["value/q"] = first[chosen].mean()
        metrics["value/target"] = goal.mean()
        return torch.minimum(first.detach(), second.detach())

    def _update_policy(self, sample: Sample, q: Tensor, metrics: dict[str, Tensor]) -> PolicyOutput:
        """Descend the policy loss, with the contrastive and the imitation loss beside it."""
        config = self.config
        with self._precision():
            output: PolicyOutput = self.policy(sample.now)
        loss = policy_loss(output, q, *self._alphas(), sample.now)
        metrics["loss/policy"] = loss
        if config.contrastive_weight > 0.0:
            contrast = self._contrast(sample, output, q)
            metrics["loss/contrastive"] = contrast
            loss = loss + config.contrastive_weight * contrast
        if config.cloning.anchor_weight > 0.0 and sample.guidance is not None:
            imitation = cloning_loss(output, sample.guidance, sample.now, config.cloning)
            metrics["loss/cloning"] = imitation.total
            metrics["cloning/expected_cost"] = imitation.expected_cost
            loss = loss + config.cloning.anchor_weight * imitation.total
        metrics["gradient/policy"] = self._optimisers["policy"].step(loss, self._rate(config.adam.policy))
        self._note_entropies(output, sample.now, metrics)
        return output

    def _contrast(self, sample: Sample, output: PolicyOutput, q: Tensor) -> Tensor:
        """Contrastive joint optimisation (Algorithm 2); whether Q or target Q judges is drawn once an update."""
        config, batch = self.config.contrastive, sample.now
        if self._rng.random() >= config.epsilon:
            with torch.no_grad(), self._precision():
                q = torch.minimum(*self.target(batch, sample.told))
        chance = torch.from_numpy(self._rng.random(len(batch.waypoint_rows), dtype=np.float32)).to(self.device)
        with torch.no_grad():
            ones = torch.ones_like(q)
            probability = waypoint_marginal(output.log_waypoint.exp(), output, batch)
            weight = waypoint_marginal(ones, output, batch)
            value = waypoint_marginal(q, output, batch) / weight.clamp(min=1e-12)
            chosen = triplets(probability, value, chance, batch.waypoint_graph, len(batch))
        loss = triplet_loss(output.waypoint_features, *chosen, config.margin)
        if config.beacons and output.beacon_features is not None:
            chance = torch.from_numpy(self._rng.random(len(batch.beacon_rows), dtype=np.float32)).to(self.device)
            with torch.no_grad():
                worth = segment_sum(output.log_waypoint.exp() * q, batch.pair_beacon, len(batch.beacon_rows))
                chosen = triplets(output.log_beacon, worth, chance, batch.beacon_graph, len(batch))
            loss = loss + triplet_loss(output.beacon_features, *chosen, config.margin)
        return loss

    def _update_temperatures(self, sample: Sample, output: PolicyOutput, metrics: dict[str, Tensor]) -> None:
        """Move both temperatures towards the target entropies."""
        if self.config.sac.learn_temperature:
            batch, fraction = sample.now, self.config.sac.target_entropy
            of_beacon, of_waypoint = entropies(output, batch)
            loss = temperature_loss(
                self.temperatures.log_beacon, of_beacon, batch.beacon_ptr.diff(), fraction
            ) + temperature_loss(self.temperatures.log_waypoint, of_waypoint, batch.waypoint_ptr.diff(), fraction)
            self._optimisers["temperatures"].step(loss, self.config.adam.temperature)
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

    def _update_average(self, stage: str) -> None:
        """Follow the policy with the average, faster in the first updates, whose weights are soon forgotten."""
        if stage == "critic" or self.config.learner.average_decay == 0.0:
            return
        decay = min(self.config.learner.average_decay, (1 + self.updates) / (10 + self.updates))
        blend(self.policy.parameters(), self.average.parameters(), 1.0 - decay)

    def _rate(self, peak: float) -> float:
        return scheduled_rate(peak, self.updates, self.config.learner.total_updates, self.config.adam)

    def _alphas(self) -> tuple[Tensor, Tensor]:
        return self.temperatures.log_beacon.detach().exp(), self.temperatures.log_waypoint.detach().exp()

    def _precision(self) -> AbstractContextManager[Any]:
        return torch.autocast(self.device.type, dtype=torch.bfloat16, enabled=self._autocast)

    def _modules(self) -> dict[str, nn.Module]:
        return {
            "policy": self.policy,
            "average": self.average,
            "critic": self.critic,
            "target": self.target,
            "temperatures": self.temperatures,
        }

    @staticmethod
    def _note_entropies(output: PolicyOutput, batch: GraphBatch, metrics: dict[str, Tensor]) -> None:
        with torch.no_grad():
            of_beacon, of_waypoint = entropies(output, batch)
        metrics["entropy/beacon"], metrics["entropy/waypoint"] = of_beacon.mean(), of_waypoint.mean()


def _to_floats(metrics: dict[str, Tensor]) -> dict[str, float]:
    """Fetch all metrics from the device at once."""
    if not metrics:
        return {}
    values = torch.stack([value.detach().float() for value in metrics.values()]).tolist()
    return dict(zip(metrics, values, strict=True))
