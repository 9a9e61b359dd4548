"""The policies that come with the package: `common/weights/<task>.safetensors`, each with its card."""

from __future__ import annotations

from pathlib import Path

from common.errors import CheckpointError
from common.system.paths import expanded

_FOLDER = Path(__file__).parents[1] / "weights"


def shipped_tasks() -> frozenset[str]:
    """Return the tasks for which a policy is shipped."""
    return frozenset(path.stem for path in _FOLDER.glob("*.safetensors"))


def shipped_policy(task: str) -> Path:
    """Return the weights that are shipped for a task.

    Raises:
        CheckpointError: none are.
    """
    path = _FOLDER / f"{task}.safetensors"
    if not path.is_file():
        raise CheckpointError(
            f"no policy is shipped for the task {task!r}, {path.name} does not exist: reinstall the package, or give "
            "your own policy (.safetensors), as written by 'hd-learner export'"
        )
    return path


def policy_path(policy: str | Path) -> Path:
    """Return where a policy lies: a file, or what is shipped for the task of that name, such as ``exploration``."""
    # A policy's file has an ending, so that no file is meant by the name of a task alone.
    return shipped_policy(str(policy)) if str(policy) in shipped_tasks() else expanded(policy)
