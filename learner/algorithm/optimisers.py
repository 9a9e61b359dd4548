"""Adam with a schedule, clipping and an exact, nameable state; averages and targets of weights."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.optim.adam import adam

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

    It keeps the moments itself and calls PyTorch's function, not its class, whose first use imports PyTorch's compiler:
    a second or two of each start.

    Args:
        module: what it trains.
        clip_norm: gradients are scaled down to this norm; None leaves them.

    Attributes:
        norm: of the gradient that waits for `apply`, None when none does.
    """

    def __init__(self, module: nn.Module, clip_norm: float | None) -> None:
        self._parameters = dict(module.named_parameters())
        self._clip_norm = clip_norm
        self._moments: dict[str, dict[str, Tensor]] = {}
        self._rate = 0.0
        self.norm: Tensor | None = None

    def prepare(self, loss: Tensor, rate: float) -> Tensor:
        """Compute the gradient of a loss for `apply` to descend at a rate; return its norm before clipping."""
        values = self._parameters.values()
        for value in values:
            value.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
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
        moved = {name: value for name, value in self._parameters.items() if value.grad is not None}
        moments = [self._moments_of(name) for name in moved]
        with torch.no_grad():
            adam(
                list(moved.values()),
                [value.grad for value in moved.values() if value.grad is not None],
                [each["exp_avg"] for each in moments],
                [each["exp_avg_sq"] for each in moments],
                [],
                [each["step"] for each in moments],
                amsgrad=False,
                beta1=0.9,
                beta2=0.999,
                lr=self._rate,
                weight_decay=0.0,
                eps=1e-8,
                maximize=False,
            )
        self.norm = None

    def _moments_of(self, name: str) -> dict[str, Tensor]:
        """Return a weight's moments and step count, zeros before its first step."""
        if name not in self._moments:
            value = self._parameters[name]
            self._moments[name] = {
                "step": torch.zeros((), dtype=torch.float32),
                "exp_avg": torch.zeros_like(value),
                "exp_avg_sq": torch.zeros_like(value),
            }
        return self._moments[name]

    def drop(self) -> None:
        """Give up the step that was prepared, if one was; the weights stay as they are."""
        self.norm = None

    def state(self) -> dict[str, Tensor]:
        """Copy the moments and step counts to the host, as ``<weight>.<moment>``."""
        return {
            f"{name}.{key}": value.detach().cpu().clone()
            for name in self._parameters
            for key, value in self._moments.get(name, {}).items()
        }

    def restore(self, state: dict[str, Tensor]) -> None:
        """Take over moments and step counts from `state`.

        Raises:
            CheckpointError: a moment belongs to no weight or has another shape.
        """
        self._moments.clear()
        for full_name, value in state.items():
            name, _, key = full_name.rpartition(".")
            parameter = self._parameters.get(name)
            if parameter is None or (key != "step" and value.shape != parameter.shape):
                raise CheckpointError(
                    f"optimiser state {full_name} of shape {tuple(value.shape)} fits no weight of this network: "
                    "resume with the configuration of the run"
                )
            place = parameter.device if key != "step" else torch.device("cpu")
            self._moments.setdefault(name, {})[key] = value.to(place).clone()


def blend(towards: Iterable[Tensor], values: Iterable[Tensor], rate: float) -> None:
    """Move weights in place: values ← values + rate (towards − values); rate 1 copies."""
    with torch.no_grad():
        for value, goal in zip(values, towards, strict=True):
            if rate >= 1.0:
                value.copy_(goal)
            else:
                value.lerp_(goal.to(value.dtype), rate)
