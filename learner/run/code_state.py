"""The code state in a run's folder."""

from __future__ import annotations

from pathlib import Path

from common.system.code_state import code_state, commit_of
from learner.run.files import to_json

__all__ = ["code_state", "commit_of", "write_code_state"]


def write_code_state(folder: Path, name: str) -> None:
    """Write `<name>.json`, and `<name>.diff` when tracked files differ from the commit."""
    state = code_state()
    diff = state["git"].pop("diff", "")
    if diff:
        (folder / f"{name}.diff").write_text(diff, "utf-8")
    (folder / f"{name}.json").write_text(to_json(state), "utf-8")
