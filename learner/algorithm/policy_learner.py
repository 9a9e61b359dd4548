"""What every learner of the policy shares: imitation, the contrastive loss, the average, and an exact state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from copy import deepcopy
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from common.config import RunConfig
from common.network.factory import make_policy_network
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyOutput
from common.network.state import load_arrays, to_arrays
from learner.algorithm.augment import augment
from learner.algorithm.auxiliary import AuxiliaryHeads
from learner.algorithm.base import NotFiniteError, RanksError
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.cloning import Guidance, cloning_loss
from learner.algorithm.compiled import compile_layers
from learner.algorithm.contrastive import contrastive_loss
from learner.algorithm.device import wants_bf16
from learner.algorithm.finiteness import not_finite, rows_not_finite
from learner.algorithm.learner_state import copy_state, load_state
from learner.algorithm.losses import entropies
from learner.algorithm.optimisers import Optimiser, blend, scheduled_rate
from learner.algorithm.sample import Sample, make_graphs
from learner.algorithm.teachers import Teachers
from learner.algorithm.whole import Ranks, drawn, mean, sharing


class PolicyLearner(ABC):
    """The policy, its moving average, and the updates that imitate the expert.

    The first `cloning.updates` updates imitate; what the others do, `_reinforce` of a subclass says. The same seed and
    batches give the same weights on the CPU.

    Usage::

        learner = SacLearner(config, torch.device("cpu"))
        metrics = learner.update(replay.sample())
        weights = learner.policy_weights(averaged=False)

    Args:
        config: of the run; make the learner within `seeded`.
        device: where the networks are.
        clip_norm: gradients of the policy are clipped to this norm.

    Attributes:
        updates: updates done.
        ranks: learner processes that share each batch with this one; None when it has all of it.
    """

    def __init__(self, config: RunConfig, device: torch.device, clip_norm: float) -> None:
        self.config = config
        self.device = device
        self.updates = 0
        self.ranks: Ranks | None = None
        self.policy = make_policy_network(config.network).to(device)
        self.average = deepcopy(self.policy).requires_grad_(False)
        self._heads = AuxiliaryHeads(config.network).to(device) if config.hinted else None
        trained = self.policy if self._heads is None else nn.ModuleList([self.policy, self._heads])
        self._optimisers = {"policy": Optimiser(trained, clip_norm)}
        self._teachers = Teachers(config)
        self._rng = np.random.default_rng(config.seed)
        self._autocast = wants_bf16(config.learner.precision, device)

    # --- what subclasses say -------------------------------------------------------------------------------------

    bootstraps: ClassVar[bool] = False
    """Whether updates after the imitation stage read o'."""

    @property
    @abstractmethod
    def stage(self) -> str:
        """What the next update does: ``cloning`` while it imitates, or a name of the subclass."""

    @abstractmethod
    def _reinforce(self, sample: Sample, metrics: dict[str, Tensor]) -> None:
        """Prepare the steps of an update after the imitation stage."""

    @abstractmethod
    def _settle(self) -> None:
        """Do what follows the steps of an update."""

    def _augmented(self, batch: TransitionBatch, rng: np.random.Generator) -> TransitionBatch:
        """Draw and apply symmetries of the world, for an update after the imitation stage."""
        return augment(batch, rng)

    def _modules(self) -> dict[str, nn.Module]:
        """Return all that has weights or buffers to save, by name."""
        heads = {} if self._heads is None else {"auxiliary": self._heads}
        return {"policy": self.policy, "average": self.average, **heads}

    def compile_networks(self) -> None:
        """Compile the layers of all networks on their first use; see `compile_layers`."""
        for module in self._modules().values():
            compile_layers(module)

    # --- the contract of `Algorithm` -----------------------------------------------------------------------------

    def update(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch; return the update's metrics by their TensorBoard names.

        Raises:
            ValueError: a chosen node is no beacon or waypoint of its observation, or the batch lacks labels.
            NotFiniteError: a figure or a gradient is not finite.
        """
        figures = self.step(batch)
        if bad := not_finite(figures):
            raise NotFiniteError(bad, self.culprits(batch))
        return figures

    def step(self, batch: TransitionBatch) -> dict[str, float]:
        """Learn from one batch, or from this rank's part of it; return the metrics, those of the whole batch.

        All losses and gradients come first. When one of them is not finite, or another rank is lost on the way, nothing
        changes.

        Raises:
            RanksError: another rank is lost.
            ValueError: as `update`.
        """
        buffers, random = self._buffers(), self._rng.bit_generator.state
        try:
            with sharing(self.ranks):
                figures = self._figures(self._turned(batch, self._rng, cloning=self.stage == "cloning"))
        except RanksError:
            self._give_up(buffers)
            self._rng.bit_generator.state = random
            raise
        if not_finite(figures):
            self._give_up(buffers)
            return figures
        moved = self._optimisers["policy"].norm is not None
        for optimiser in self._optimisers.values():
            optimiser.apply()
        if moved and self.config.learner.average_decay > 0.0:
            # It soon forgets the first updates.
            decay = min(self.config.learner.average_decay, (1 + self.updates) / (10 + self.updates))
            blend(self.policy.parameters(), self.average.parameters(), 1.0 - decay)
        self._settle()
        self.updates += 1
        return figures

    def prepare(self, batch: TransitionBatch, rng: np.random.Generator, *, cloning: bool) -> TransitionBatch:
        """Apply symmetries and build the graphs of a batch; see `Prepare`."""
        turned = self._turned(batch, rng, cloning=cloning)
        graphs = make_graphs(turned, self.config, self.device, self.bootstraps and not cloning)
        return replace(turned, graphs=graphs)

    def adopt(self, weights: dict[str, NDArray[np.float32]]) -> None:
        """Begin with these policy weights; all else stays as it is.

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
        return copy_state(self._modules(), self._optimisers, self.updates, self._rng)

    def restore(self, tensors: dict[str, Tensor], values: dict[str, Any]) -> None:
        """Continue from a `state`.

        Raises:
            CheckpointError: the state lacks something, as that of another algorithm does.
            WeightsError: a weight does not fit this configuration; the error names it.
        """
        self.updates = load_state(self._modules(), self._optimisers, self._rng, tensors, values)

    # --- parts for subclasses ------------------------------------------------------------------------------------

    def _turned(self, batch: TransitionBatch, rng: np.random.Generator, *, cloning: bool) -> TransitionBatch:
        """Return a batch under symmetries of the world, unless it is so already or they are switched off."""
        if batch.graphs is not None or not self.config.learner.augment:
            return batch
        return augment(batch, rng) if cloning else self._augmented(batch, rng)

    def _imitate(self, sample: Sample, metrics: dict[str, Tensor]) -> None:
        """Prepare the descent of the imitation loss; a batch without labels changes nothing."""
        if sample.guidance is None:
            return
        with self._precision():
            output = self.policy(sample.now)
        loss = cloning_loss(output, sample.guidance, sample.now, self.config.cloning)
        total = loss.total + self._auxiliary(output, sample.guidance, metrics)
        rate = scheduled_rate(
            self.config.cloning.learning_rate,
            self.updates,
            self.config.learner.total_updates,
            self.config.adam.model_copy(update={"schedule": "constant"}),
        )
        metrics["loss/cloning"] = loss.total
        metrics["cloning/expected_cost"] = loss.expected_cost
        metrics["cloning/cross_entropy"] = loss.cross_entropy
        metrics["cloning/beacon_cross_entropy"] = loss.beacon_cross_entropy
        metrics["cloning/following"] = loss.following
        self._descend(total, rate, output, sample.now, metrics)

    def _auxiliary(self, output: PolicyOutput, guidance: Guidance, metrics: dict[str, Tensor]) -> Tensor:
        """Return the weighted loss of what the network shall foresee, a scalar; 0 where nothing tells it."""
        if self._heads is None or guidance.hints is None:
            return output.log_waypoint.new_zeros(())
        with self._precision():
            free, gain = self._heads(output, guidance.hints)
        metrics["auxiliary/free_space"], metrics["auxiliary/gain"] = free, gain
        weighted: Tensor = self.config.cloning.auxiliary_weight * (free + gain)
        return weighted

    def _descend(
        self, loss: Tensor, rate: float, output: PolicyOutput, batch: GraphBatch, metrics: dict[str, Tensor]
    ) -> None:
        """Prepare the policy's step down a loss."""
        metrics["gradient/policy"] = self._optimisers["policy"].prepare(loss, rate)
        with torch.no_grad():
            of_beacon, of_waypoint = entropies(output, batch)
        metrics["entropy/beacon"], metrics["entropy/waypoint"] = mean(of_beacon), mean(of_waypoint)

    def _contrast(self, batch: GraphBatch, output: PolicyOutput, q: Tensor) -> Tensor:
        """Contrastive joint optimisation (Algorithm 2) with the values q of all pairs as the judge."""
        return contrastive_loss(output, batch, q, self.config.contrastive, self._chance)

    # --- batches that nothing can be learnt from -----------------------------------------------------------------

    def _figures(self, batch: TransitionBatch) -> dict[str, float]:
        """Prepare all steps of an update; return its metrics, gradients among them."""
        metrics: dict[str, Tensor] = {}
        cloning = self.stage == "cloning"
        sample = Sample.make(batch, self.config, self.device, self.bootstraps and not cloning, self._teachers)
        if cloning:
            self._imitate(sample, metrics)
        else:
            self._reinforce(sample, metrics)
        return _to_floats(metrics)

    def _buffers(self) -> list[tuple[Tensor, Tensor]]:
        """Return what a prepared update may have changed already, running means and the like, with copies of it."""
        return [(buffer, buffer.clone()) for module in self._modules().values() for buffer in module.buffers()]

    def _give_up(self, buffers: list[tuple[Tensor, Tensor]]) -> None:
        """Drop the prepared steps and put the buffers back."""
        for optimiser in self._optimisers.values():
            optimiser.drop()
        for buffer, before in buffers:
            buffer.copy_(before)

    def culprits(self, batch: TransitionBatch) -> NDArray[np.int64]:
        """Return the rows that are not finite by themselves, none when most of them are; nothing changes."""
        random, buffers = self._rng.bit_generator.state, self._buffers()

        def is_finite(chosen: NDArray[np.bool_]) -> bool:
            figures = self._figures(batch.select(chosen))
            self._give_up(buffers)
            return not not_finite(figures)

        found = rows_not_finite(len(batch), is_finite)
        self._rng.bit_generator.state = random
        return found

    def _chance(self, own: int) -> Tensor:
        """Draw a number in [0, 1) for each of so many items, float32."""
        chance = drawn(lambda size: self._rng.random(size, dtype=np.float32), own)
        return torch.from_numpy(chance).to(self.device)

    def _rate(self, peak: float) -> float:
        return scheduled_rate(peak, self.updates, self.config.learner.total_updates, self.config.adam)

    def _precision(self) -> AbstractContextManager[Any]:
        return torch.autocast(self.device.type, dtype=torch.bfloat16, enabled=self._autocast)


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Let networks that are made within begin with the weights of this seed, and leave torch's own chance alone."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        yield


def _to_floats(metrics: dict[str, Tensor]) -> dict[str, float]:
    """Fetch all metrics from the device at once."""
    if not metrics:
        return {}
    values = torch.stack([value.detach().float() for value in metrics.values()]).tolist()
    return dict(zip(metrics, values, strict=True))
