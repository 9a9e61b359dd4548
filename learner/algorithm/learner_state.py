"""The state of a learner from which it resumes exactly: to named tensors and values that JSON can hold, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from torch import Tensor, nn

from common.errors import CheckpointError
from common.network.state import load_arrays
from learner.algorithm.optimisers import Optimiser


def copy_state(
    modules: Mapping[str, nn.Module], optimisers: Mapping[str, Optimiser], updates: int, rng: np.random.Generator
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Copy the state of a learner to the host.

    Args:
        modules: all that has weights or buffers, by name.
        optimisers: by name.
        updates: done so far.
        rng: the learner's source of chance.

    Returns:
        Tensors by ``<module>/<weight>`` and ``optimiser.<name>/<weight>.<moment>``; and updates, the state of chance,
        and how many tensors each optimiser has.
    """
    tensors: dict[str, Tensor] = {}
    for module, values in modules.items():
        for name, value in values.state_dict().items():
            tensors[f"{module}/{name}"] = value.detach().cpu().clone().contiguous()
    moments: dict[str, int] = {}
    for optimiser, adam in optimisers.items():
        held = adam.state()
        moments[optimiser] = len(held)
        tensors.update({f"optimiser.{optimiser}/{name}": value for name, value in held.items()})
    return tensors, {"updates": updates, "random": rng.bit_generator.state, "moments": moments}


def load_state(
    modules: Mapping[str, nn.Module],
    optimisers: Mapping[str, Optimiser],
    rng: np.random.Generator,
    tensors: Mapping[str, Tensor],
    values: Mapping[str, Any],
) -> int:
    """Put what `copy_state` returned into a learner's parts; return the updates done.

    Raises:
        CheckpointError: the state lacks something, as that of another algorithm does.
        WeightsError: a weight does not fit this configuration; the error names it.
    """
    groups: dict[str, dict[str, Tensor]] = {}
    for full_name, value in tensors.items():
        group, _, name = full_name.partition("/")
        groups.setdefault(group, {})[name] = value
    missing = (set(modules) - set(groups)) | ({"updates", "random", "moments"} - set(values))
    for optimiser, count in values.get("moments", {}).items():
        if len(groups.get(f"optimiser.{optimiser}", {})) != count:
            missing.add(f"optimiser.{optimiser}")
    if missing:
        raise CheckpointError(
            f"the learner's state lacks all or part of {sorted(missing)}: use an older checkpoint, and the "
            "algorithm of the run"
        )
    for module, held in modules.items():
        load_arrays(held, {name: value.numpy() for name, value in groups[module].items()})
    for optimiser, adam in optimisers.items():
        adam.restore(groups.get(f"optimiser.{optimiser}", {}))
    rng.bit_generator.state = values["random"]
    return int(values["updates"])
