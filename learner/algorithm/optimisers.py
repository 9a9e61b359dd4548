"""Adam with a schedule, clipping and an exact, nameable state; averages and targets of weights."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn

from common.config import AdamConfig
from common.errors import CheckpointError
from learner.algorithm.whole import sum_gradients


def scheduled_rate(peak: float, update: int, total_updates: int, config: AdamConfig) -> float:
    """Return the learning rate of update number ``update``, counted from 0.

    Linear warm-up from 0 over `warmup_updates`, then constant, linear or cosine descent to `final_fraction` of the
    peak at ``total_updates``.
    """
    if update < config.warmup_updates:
        return peak * (update + 1) / config.warmup_updates
    span = max(total_updates - config.warmup_updates, 1)
    progress = min((update - config.warmup_updates) / span, 1.0)
    left = {
        "constant": 1.0,
        "linear": 1.0 - progress,
        "cosine": 0.5 * (1.0 + math.cos(math.pi * progress)),
    }[config.schedule]
    return peak * (config.final_fraction + (1.0 - config.final_fraction) * left)


class Optimiser:
    """Adam over the weights of one module, in two halves: a gradient first, the step once all of an update is sound.

    Args:
        module: what it trains.
        clip_norm: gradients are scaled down to this norm; None leaves them.

    Attributes:
        norm: of the gradient that waits for `apply`, None when none does.
    """

    def __init__(self, module: nn.Module, clip_norm: float | None) -> None:
        self._parameters = dict(module.named_parameters())
        self._clip_norm = clip_norm
        self._adam = torch.optim.Adam(self._parameters.values())
        self._rate = 0.0
        self.norm: Tensor | None = None

    def prepare(self, loss: Tensor, rate: float) -> Tensor:
        """Compute the gradient of a loss for `apply` to descend at a rate; return its norm before clipping."""
        self._adam.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        values = self._parameters.values()
        sum_gradients(values)
        if self._clip_norm is None:
            norm = nn.utils.get_total_norm([value.grad for value in values if value.grad is not None])
        else:
            norm = nn.utils.clip_grad_norm_(values, self._clip_norm)
        self.norm = norm
        self._rate = rate
        return norm

    def apply(self) -> None:
        """Take the step that was prepared, if one was."""
        if self.norm is None:
            return
        for group in self._adam.param_groups:
            group["lr"] = self._rate
        self._adam.step()
        self.norm = None

    def drop(self) -> None:
        """Give up the step that was prepared, if one was; the weights stay as they are."""
        self.norm = None

    def state(self) -> dict[str, Tensor]:
        """Copy the moments and step counts to the host, as ``<weight>.<moment>``."""
        return {
            f"{name}.{key}": value.detach().cpu().clone()
            for name, parameter in self._parameters.items()
            for key, value in self._adam.state.get(parameter, {}).items()
        }

    def restore(self, state: dict[str, Tensor]) -> None:
        """Take over moments and step counts from `state`.

        Raises:
            CheckpointError: a moment belongs to no weight or has another shape.
        """
        self._adam.state.clear()
        for full_name, value in state.items():
            name, _, key = full_name.rpartition(".")
            parameter = self._parameters.get(name)
            if parameter is None or (key != "step" and value.shape != parameter.shape):
                raise CheckpointError(
                    f"optimiser state {full_name} of shape {tuple(value.shape)} fits no weight of this network: "
                    "resume with the configuration of the run"
                )
            place = parameter.device if key != "step" else torch.device("cpu")
            self._adam.state[parameter][key] = value.to(place).clone()


def blend(towards: Iterable[Tensor], values: Iterable[Tensor], rate: float) -> None:
    """Move weights in place: values ← values + rate (towards − values); rate 1 copies."""
    with torch.no_grad():
        for value, goal in zip(values, towards, strict=True):
            if rate >= 1.0:
                value.copy_(goal)
            else:
                value.lerp_(goal.to(value.dtype), rate)
