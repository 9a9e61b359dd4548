"""Files that are either whole or absent, whatever happens while they are written."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any


def sync_path(path: Path) -> None:
    """Bring a file's or a folder's content onto the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace_text(path: Path, text: str) -> None:
    """Replace a text file at one stroke: readers see the old content or the new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.write_text(text, "utf-8")
    sync_path(temporary)
    temporary.replace(path)
    sync_path(path.parent)


def to_json(value: Any) -> str:
    """Return indented JSON with a final line feed; infinities and NaN are refused."""
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def file_digest(path: Path) -> str:
    """SHA-256 of a file as hexadecimal text."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
