"""Where compiled kernels are kept, and what is known of them; nothing here imports numba, which takes half a second."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import time
from pathlib import Path
from typing import Final

_SOURCES: Final = Path(__file__).parents[2]
_COMPILER: Final = Path(__file__).with_name("jit.py")
# In two parts, for this module has no kernels.
_MARK: Final = b"import " + b"njit"
_PACKAGES: Final = ("common", "actors", "learner", "deploy")
_FORGET_SECONDS: Final = 7 * 86400.0


@functools.cache
def cache_folder(package: str) -> Path:
    """Folder of a package's compiled kernels for the sources as they are now."""
    from importlib.metadata import version

    digest = hashlib.blake2b(version("numba").encode(), digest_size=8)
    for name in sorted({"common", package}):
        for path in sorted((_SOURCES / name).rglob("*.py")):
            text = path.read_bytes()
            if _MARK in text or path == _COMPILER:
                digest.update(str(path).encode() + text)
    return _caches() / f"{package}-{digest.hexdigest()}"


def kernels_are_compiled(package: str) -> bool:
    """Tell whether kernels of a package were compiled before, for the sources as they are now."""
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_folder(package))
    return any(folder.rglob("*.nbc"))


def forget_old_caches() -> None:
    """Delete caches that nobody has used for a week; call it where kernels are warmed up."""
    current = {cache_folder(package) for package in _PACKAGES}
    # A folder that cannot be written to keeps what it has, and another process may be forgetting at the same time.
    with contextlib.suppress(OSError):
        for folder in current:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
        for folder in _caches().iterdir():
            if folder not in current and time.time() - folder.stat().st_mtime > _FORGET_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)


def is_prepared(package: str, use: str) -> bool:
    """Tell whether a use of a package's kernels was noted as prepared, for these sources and this kind of processor."""
    if _users_own_folder():
        return False
    try:
        return _note(package, use).exists()
    except OSError:
        return False


def note_prepared(package: str, use: str) -> None:
    """Note that all kernels that a use of a package calls are compiled and kept.

    Args:
        package: of the kernels.
        use: tells this use from others.
    """
    if _users_own_folder():
        return
    with contextlib.suppress(OSError):
        _note(package, use).touch()


def _users_own_folder() -> bool:
    """Whether kernels are kept where the user says: notes lie elsewhere, and it may hold those of other sources."""
    return bool(os.environ.get("NUMBA_CACHE_DIR"))


def _note(package: str, use: str) -> Path:
    from llvmlite.binding import get_host_cpu_name

    # Machines of several kinds may share a home; numba compiles for each.
    digest = hashlib.blake2b(f"{get_host_cpu_name()}\n{use}".encode(), digest_size=8)
    return cache_folder(package) / f"prepared-{digest.hexdigest()}"


def _caches() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "hdplanner" / "kernels"
    except RuntimeError:
        # A user whom the system does not know, as in many containers, has no home unless the environment names one.
        return Path("/.cache/hdplanner/kernels")
