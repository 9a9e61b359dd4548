"""Files that are either whole or absent, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import logging
import os
from pathlib import Path
from typing import Any

logger = logging.getLogger(__name__)

DAMAGED = "damaged"
"""Folder of a run for bytes that cannot be read any more; nothing is thrown away."""


def sync_descriptor(descriptor: int) -> None:
    """Bring an open file's content, and what is needed to find it, onto the disk.

    macOS keeps it in the drive's cache after `fsync`, and has a command of its own for the rest of the way.
    """
    if hasattr(fcntl, "F_FULLFSYNC"):
        fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
    elif hasattr(os, "fdatasync"):
        os.fdatasync(descriptor)
    else:
        os.fsync(descriptor)


def sync_path(path: Path) -> None:
    """Bring a file's or a folder's content onto the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, that are still there after a power failure."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync_path(folder.parent)


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of ``data``; what one call leaves out goes into the next."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def replace_bytes(path: Path, content: bytes) -> None:
    """Replace a file at one stroke: readers, and the disk after a power failure, have the old content or the new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        sync_path(temporary)
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
    sync_path(path.parent)


def replace_text(path: Path, text: str) -> None:
    """Replace a text file at one stroke, as `replace_bytes` does."""
    replace_bytes(path, text.encode("utf-8"))


def remove_leftovers(folder: Path) -> None:
    """Delete the files under temporary names in ``folder`` that a killed writer left; only its one writer may."""
    for leftover in folder.glob(".*.tmp"):
        if leftover.is_file():
            leftover.unlink()


def set_aside(folder: Path, name: str, content: bytes) -> Path:
    """Keep bytes that cannot be read in ``folder``, made when missing; return their file, never one that was there."""
    make_folder(folder)
    path, number = folder / name, 1
    while path.exists():
        if path.read_bytes() == content:
            return path
        number += 1
        path = folder / f"{name}.{number}"
    replace_bytes(path, content)
    return path


def to_json(value: Any) -> str:
    """Return indented JSON with a final line feed; infinities and NaN are refused."""
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def file_digest(path: Path) -> str:
    """SHA-256 of a file as hexadecimal text."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
