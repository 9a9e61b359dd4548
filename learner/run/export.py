"""Policies out of checkpoints, for robots and evaluation."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from common.errors import CheckpointError
from common.policies.onnx_file import SUFFIX as ONNX_SUFFIX
from common.policies.policy_file import PolicyCard, card_from, write_onnx, write_policy
from learner.run.best import VALIDATION
from learner.run.checkpoints import EXPORT_PREFIX, Checkpoint, CheckpointStore
from learner.run.folder import check_run, read_config
from learner.run.onnx_model import onnx_model

logger = logging.getLogger(__name__)


def export_policy(run: Path, which: str, out: Path) -> PolicyCard:
    """Write a policy of a run; the run may be in training.

    Args:
        run: folder of the run.
        which: ``best``, ``last``, or the name of a checkpoint.
        out: file to write, ending in ``.safetensors`` (its card lies beside it) or ``.onnx`` (its card is inside).

    Raises:
        CheckpointError: when there is no such policy, it is damaged, or the package onnx is needed and not installed.
    """
    check_run(run)
    config = read_config(run)
    store = CheckpointStore(run / "checkpoints", config.checkpoints.keep, writer=False)
    name = store.pointer(which) if which in ("best", "last") else which
    if name is None and which == "best":
        name = store.pointer("last")
        logger.warning("no complete evaluation has chosen a best policy yet: exporting the last checkpoint instead")
    if name is None:
        raise CheckpointError(f"run {run.name} has no checkpoint yet")
    checkpoint = store.load(name)
    document = checkpoint.document if name.startswith("policy-") else checkpoint.document.get("policy")
    if not isinstance(document, dict):
        raise CheckpointError(f"checkpoint {store.folder / name} describes no policy: export another one with --which")
    if name.startswith("policy-"):
        card = card_from({key: value for key, value in document.items() if key != VALIDATION})
        arrays = {key: tensor.numpy() for key, tensor in checkpoint.tensors.items()}
    else:
        sizes = {"network": config.network.model_dump(), "mapping": config.mapping.model_dump()}
        card = card_from({**document, **sizes})
        arrays = policy_of(checkpoint)
    if out.suffix == ONNX_SUFFIX:
        write_onnx(out, onnx_model(card.network, arrays), card)
    else:
        write_policy(out, arrays, card)
    return card


def policy_of(checkpoint: Checkpoint) -> dict[str, NDArray[Any]]:
    """Return the policy that a training checkpoint carries for export."""
    found = {
        name.removeprefix(EXPORT_PREFIX): tensor.numpy()
        for name, tensor in checkpoint.tensors.items()
        if name.startswith(EXPORT_PREFIX)
    }
    if not found:
        raise CheckpointError(f"checkpoint {checkpoint.name} carries no policy for export")
    return found
