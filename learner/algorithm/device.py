"""Where the learner computes, and how precisely."""

from __future__ import annotations

import torch

from common.errors import ConfigError


def choose_device(name: str) -> torch.device:
    """Return the device of `learner.device`: ``auto`` is CUDA when present, else the CPU.

    Raises:
        ConfigError: CUDA is asked for, and this machine has none.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise ConfigError(f"learner.device is {name}, but torch finds no CUDA device here: use auto or cpu")
    try:
        return torch.device(name)
    except RuntimeError as error:
        raise ConfigError(f"learner.device: expected auto, cpu, cuda or cuda:N, got {name!r}") from error


def wants_bf16(precision: str, device: torch.device) -> bool:
    """Whether to compute under bfloat16 autocast: ``auto`` does on a CUDA device that has it."""
    if precision == "auto":
        return device.type == "cuda" and torch.cuda.is_bf16_supported()
    return precision == "bf16"
