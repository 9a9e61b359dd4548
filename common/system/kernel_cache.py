"""numba's cache of compiled kernels, where a file may be damaged, and the folder full or closed to writing.

numba itself leaves a folder aside that it cannot write to, however much it holds (a container whose file system is
read-only), and compiles into the sources' own folder, where it follows changes of called kernels no more, or not at
all; and an error of a file ends the program that calls the kernel. A cache is no more than a faster start: here it is
read wherever it can be read, and what goes wrong with it is said once.
"""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from typing import Any, Final

from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator

log = logging.getLogger(__name__)

_said: Final[set[str]] = set()


class _Folder(UserProvidedCacheLocator):
    """The folder that `numba.config.CACHE_DIR` names, whether it can be written to or not."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Folder | None:
        # numba tries to write into the folder here; it does so again before it keeps anything.
        return cls(py_func, py_file) if Path(py_file).exists() else None


class _Implementation(CompileResultCacheImpl):
    _locator_classes = [_Folder, *CompileResultCacheImpl._locator_classes]  # noqa: RUF012


class KernelCache(FunctionCache):
    """The cache of one kernel; the caller gives it to the kernel in place of numba's own.

    Usage::

        kernel = numba.njit(function)
        kernel._cache = KernelCache(function)
    """

    _impl_class = _Implementation

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature; None where the cache does not hold it, or holds it damaged."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except OSError:
            return None
        except Exception as error:  # noqa: BLE001 - whatever unpickling makes of the bytes that a power failure left
            _say(
                "damaged", f"damaged kernels in {self.cache_path} are compiled again ({type(error).__name__}: {error})"
            )
            # The index would be read once more to keep what is compiled now.
            with contextlib.suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, as far as the folder takes it."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _say(
                "lost",
                f"compiled kernels cannot be kept in {self.cache_path} ({error.strerror}), each start compiles them "
                "again: make room there, or set XDG_CACHE_HOME to a folder that can be written to",
            )


def _say(kind: str, sentence: str) -> None:
    """Log the first warning of a kind."""
    if kind not in _said:
        _said.add(kind)
        log.warning("%s", sentence)
