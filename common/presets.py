"""Settings that ship: files of TOML in one folder for each kind of configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Final

RUN_PRESETS: Final = Path(__file__).parent / "config" / "presets"
"""Those of a run."""


def names_in(folder: Path) -> list[str]:
    """Return the names of the presets in a folder."""
    return sorted(file.stem for file in folder.glob("*.toml"))
