"""The policies that come with the package: `common/weights/<task>.safetensors`, each with its card."""

from __future__ import annotations

from pathlib import Path

from common.errors import CheckpointError

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
            f"no policy is shipped for the task {task!r}, there is no {path.name}: reinstall the package, "
            "or name a policy of your own (.safetensors), as 'hd-learner export' writes it"
        )
    return path
