"""Where the learner computes, and how precisely."""

from __future__ import annotations

import logging

import torch

from common.errors import ConfigError

logger = logging.getLogger(__name__)


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
    """Whether to compute under bfloat16 autocast: ``auto`` does where the device has instructions for it.

    Elsewhere a processor emulates them, which takes several times as long as fp32; who asks for that is warned.
    """
    native = torch.cuda.is_bf16_supported(including_emulation=False) if device.type == "cuda" else cpu_has_bf16()
    if precision == "bf16" and not native:
        logger.warning(
            "learner.precision is bf16, but %s has no instructions for it: updates take several times as long as in "
            "fp32; use auto",
            "this processor" if device.type == "cpu" else device,
        )
    return native if precision == "auto" else precision == "bf16"


def cpu_has_bf16() -> bool:
    """Whether this processor multiplies bfloat16 by itself."""
    # PyTorch has no public question for it yet.
    return bool(torch.cpu._is_avx512_bf16_supported()) or bool(torch.cpu._is_amx_tile_supported())
