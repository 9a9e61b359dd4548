"""numba's `njit` with a cache that follows the sources.

numba looks for a new version of a cached kernel only in the kernel's own file, so an edited kernel that others call
would live on inside them, and a software update could run old machine code. Here the cache's folder is named after
the contents of all modules whose kernels a kernel can call, those of its own package and of `common`: any change of
them begins a new folder. It also works where the software's own folder cannot be written to. A user's own
NUMBA_CACHE_DIR wins.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_SOURCES = Path(__file__).parents[2]
_MARK = b"import njit"
_FORGET_SECONDS = 7 * 86400.0


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to machine code, as `numba.njit` does; with ``cache=True`` into our folder."""

    def decorate(function: Callable[..., Any]) -> Any:
        if not os.environ.get("NUMBA_CACHE_DIR"):
            # Read when the function is decorated, so it can differ from function to function.
            numba.config.CACHE_DIR = str(cache_folder(function.__module__.split(".")[0]))  # type: ignore[attr-defined]
        return numba.njit(**options)(function)

    return decorate


@functools.cache
def cache_folder(package: str) -> Path:
    """Folder of a package's compiled kernels for the sources as they are now."""
    digest = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for name in sorted({"common", package}):
        for path in sorted((_SOURCES / name).rglob("*.py")):
            text = path.read_bytes()
            if _MARK in text:
                digest.update(str(path).encode() + text)
    return _caches() / f"{package}-{digest.hexdigest()}"


def kernels_are_compiled(package: str) -> bool:
    """Tell whether kernels of a package were compiled before, for the sources as they are now."""
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_folder(package))
    return any(folder.rglob("*.nbc"))


def forget_old_caches() -> None:
    """Delete caches that nobody has used for a week; call it where kernels are warmed up."""
    current = {cache_folder(package) for package in ("common", "actors", "learner", "deploy")}
    for folder in current:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    for folder in _caches().iterdir():
        if folder not in current and time.time() - folder.stat().st_mtime > _FORGET_SECONDS:
            shutil.rmtree(folder, ignore_errors=True)


def _caches() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "hdplanner" / "kernels"
