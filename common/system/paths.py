"""Paths as people write them: with a tilde, or so that the system refuses even to look for them."""

from __future__ import annotations

from pathlib import Path


def expanded(path: str | Path) -> Path:
    """Return a path with the home folder in place of a leading ``~`` or ``~user``.

    Where there is no such user the path stays as it is, as in a shell.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def exists(path: Path) -> bool:
    """Whether there is something at a path; not where its name is too long, or a folder on the way may not be read."""
    try:
        return path.exists()
    except OSError:
        return False


def is_file(path: Path) -> bool:
    """Whether there is a file at a path; see `exists`."""
    try:
        return path.is_file()
    except OSError:
        return False
