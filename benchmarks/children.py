"""Processes of the benchmarks, which are no part of what is installed: their modules must be found from any folder."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from common.system.runtime import process_environment

ROOT: Final = Path(__file__).parents[1]


def child_environment() -> dict[str, str]:
    """Return the environment of a process that runs a module of the benchmarks, with one numerical thread."""
    return process_environment(threads=1) | {"PYTHONPATH": str(ROOT)}
