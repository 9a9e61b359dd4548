"""Weights of torch modules as named arrays, and back."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from common.network.parameters import Arrays, check_parameters


def to_arrays(module: nn.Module) -> dict[str, NDArray[np.float32]]:
    """Copy a module's weights to the host as float32 arrays."""
    state = module.state_dict()
    return {name: value.detach().float().cpu().numpy().copy() for name, value in state.items()}


def load_arrays(module: nn.Module, arrays: Arrays) -> None:
    """Copy named arrays into a module.

    Raises:
        WeightsError: a weight is missing, unknown, of another shape or type, or not finite; the error names it.
    """
    state = module.state_dict()
    check_parameters(arrays, {name: tuple(value.shape) for name, value in state.items()})
    with torch.no_grad():
        for name, value in state.items():
            value.copy_(torch.from_numpy(np.array(arrays[name], order="C")))
