"""The state of the code that a result was made with: commit, status and differences."""

from __future__ import annotations

import importlib.metadata
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

_PACKAGES = ("numpy", "torch", "numba", "eclipse-zenoh", "safetensors", "pydantic")


def code_state() -> dict[str, Any]:
    """Describe the code and its environment: `git` holds commit, status and diff, or says why it cannot."""
    return {
        "git": _git_state(Path(__file__).resolve().parent),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in ("hdplanner", *_PACKAGES)},
        "command": sys.argv,
    }


def commit_of(state: dict[str, Any]) -> str:
    """Return the commit in a state, with a mark when files differ from it, or a word saying that it is unknown."""
    git = state["git"]
    if "commit" not in git:
        return f"unknown ({git['absent']})"
    return git["commit"] + ("+changes" if git["status"] else "")


def _git_state(folder: Path) -> dict[str, Any]:
    if shutil.which("git") is None:
        return {"absent": "git is not installed"}
    try:
        return {
            "commit": _git(folder, "rev-parse", "HEAD").strip(),
            "status": _git(folder, "status", "--porcelain"),
            "diff": _git(folder, "diff", "HEAD"),
        }
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired, OSError):
        return {"absent": "the code is not in a git repository"}


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, check=True, timeout=10, text=True, errors="replace")
    return done.stdout


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
