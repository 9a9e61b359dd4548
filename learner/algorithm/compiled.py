"""Compiles what an encoder's layers do beside the attention, with `torch.compile`: fewer and larger kernels.

On a GPU an update is thousands of small kernels that Python starts one by one (docs/speed.md). Norms, projections,
feed-forward blocks and the conversions between them become a few; the attention stays as it is, because it reads the
graph.
"""

from __future__ import annotations

import torch
from torch import nn

from common.errors import ConfigError
from common.network.encoder import EncoderLayer


def compile_layers(module: nn.Module) -> None:
    """Compile the layers of all encoders in ``module`` on their first use, once for any number of nodes.

    Weights, their names and gradients stay as they are; results differ by rounding. Copies of the module share its
    compiled layers, so copy first.
    """
    for layer in module.modules():
        if isinstance(layer, EncoderLayer):
            for name in ("project", "complete"):
                # Batches differ in their number of nodes: without `dynamic` each of the first ones compiles anew.
                setattr(layer, name, torch.compile(getattr(layer, name), dynamic=True))


def check_compiler(device: torch.device) -> None:
    """Compile a sum.

    Raises:
        ConfigError: this machine cannot; the error tells what torch says.
    """
    # Imported here: it takes a second, which only those who compile need to wait for.
    from torch._dynamo.exc import TorchDynamoException

    try:
        torch.compile(torch.add, dynamic=True)(torch.ones(2, device=device), 1.0)
    except (TorchDynamoException, RuntimeError) as error:
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        raise ConfigError(
            f"learner.compile is true, but torch cannot compile for {device} here ({reason}): install a C++ compiler "
            "(g++), on GPUs Triton as well, or leave the option out"
        ) from error
