"""Trained policies, from a file or as they ship."""

from __future__ import annotations

from pathlib import Path

from common.policies.policy import Policy
from common.policies.policy_file import PolicyCard, read_policy
from common.policies.shipped import policy_path, shipped_policy


def load_policy(path: str | Path | None = None, *, task: str = "exploration") -> tuple[Policy, PolicyCard]:
    """Load a policy, ready to act, with the card that says what it is and where it comes from.

    ``make_planner("hdplanner", config, policy=load_policy(...))`` makes a planner of it.

    Args:
        path: weights (.safetensors) with their card beside them, or an .onnx file, as `hd-learner export` writes them,
            or the task of a policy that ships; the one of ``task`` when not given.
        task: of the policy that ships.

    Raises:
        CheckpointError: it cannot be read, or none ships for the task.
        WeightsError: the weights do not fit the network of the card.
    """
    return read_policy(shipped_policy(task) if path is None else policy_path(path))
