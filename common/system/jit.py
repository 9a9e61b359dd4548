"""numba's `njit` with a cache that follows the sources.

numba looks for a new version of a cached kernel only in the kernel's own file, so an edited kernel that others call
would live on inside them, and a software update could run old machine code. Here the cache's folder is named after
the contents of all modules whose kernels a kernel can call, those of its own package and of `common`: any change of
them begins a new folder. It also works where the software's own folder cannot be written to, and where this one cannot
(`common.system.kernel_cache`). A user's own NUMBA_CACHE_DIR wins.

Processes that start together need the same kernels: each is compiled by one of them, while the others wait for it and
load it. A process that compiles says so in its log, and every few seconds how many kernels it has compiled. SIGINT,
SIGTERM and SIGHUP are heard between two kernels.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import gc
import logging
import os
import signal
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Any

import numba
from numba.core.compiler_lock import global_compiler_lock
from numba.core.types import unliteral

from common.system.kernel_cache import KernelCache
from common.system.kernel_folders import cache_folder

log = logging.getLogger(__name__)

_SAY_SECONDS = 10.0
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to machine code, as `numba.njit` does; with ``cache=True`` into our folder."""

    def decorate(function: Callable[..., Any]) -> Any:
        if not os.environ.get("NUMBA_CACHE_DIR"):
            # Read when the function is decorated, so it can differ from function to function.
            numba.config.CACHE_DIR = str(cache_folder(function.__module__.split(".")[0]))  # type: ignore[attr-defined]
        # Nobody calls a kernel from C; leaving that entry out saves a tenth of what compiling takes.
        lean: dict[str, Any] = {"no_cfunc_wrapper": True, **options, "cache": False}
        kernel = numba.njit(**lean)(function)
        if options.get("cache"):
            kernel._cache = KernelCache(function)  # type: ignore[no-untyped-call]
            _compile_in_one_process(kernel, Path(numba.config.CACHE_DIR))  # type: ignore[attr-defined]
        return kernel

    return decorate


class _Progress:
    """Tells of kernels that this process compiles: a first start takes a minute, and should not look frozen."""

    def __init__(self) -> None:
        self._compiled = 0
        self._began = self._said = 0.0

    def begin(self) -> None:
        """A kernel is to be compiled or loaded."""
        if not self._compiled:
            self._began = time.monotonic()

    def note(self, kernel: Any) -> None:
        """A kernel was compiled."""
        self._compiled += 1
        now = time.monotonic()
        if self._compiled == 1:
            log.info("compiling kernels, which the next start loads")
        elif now - self._said > _SAY_SECONDS:
            seconds, module = now - self._began, kernel.py_func.__module__
            log.info("compiled %d kernels in %.0f s, the last one of %s", self._compiled, seconds, module)
        else:
            return
        self._said = now


_progress = _Progress()


class _HeldSignals:
    """Holds back SIGINT, SIGTERM and SIGHUP while a kernel is compiled, and lets them be handled when it is.

    Their handlers raise exceptions while a process prepares itself. One that is raised where LLVM calls back is lost:
    the process would not end, or with an error of the compiler. Compiling a kernel compiles those that it calls, so
    this nests, and signals are handled at the end of the inner one. Only the main thread handles signals.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._handlers: dict[signal.Signals, Callable[[int, FrameType | None], Any]] = {}
        self._came: list[int] = []

    def __enter__(self) -> None:
        self._depth += 1
        if self._depth == 1:
            self._hold()

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        came, self._came = self._came, []
        if came or not self._depth:
            # Once alone: a handler may have put another one in its place before it raised.
            handlers, self._handlers = self._handlers, {}
            for number, handler in handlers.items():
                signal.signal(number, handler)
        for each in came:
            signal.raise_signal(each)
        if came and self._depth:
            self._hold()

    def _hold(self) -> None:
        found = {number: signal.getsignal(number) for number in _ENDING}
        self._handlers = {number: handler for number, handler in found.items() if callable(handler)}
        for number in self._handlers:
            signal.signal(number, lambda number, _: self._came.append(number))


_held_signals = _HeldSignals()


def _compile_in_one_process(kernel: Any, folder: Path) -> None:
    """Let one process at a time compile a kernel; numba's own cache is read without a lock, and not again."""
    compile_now = kernel.compile
    place = zlib.crc32(f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}".encode())

    def compile_once(signature: Any) -> Any:
        _leave_scipy_out()
        if isinstance(signature, tuple):
            # A kernel that calls this one with a constant would have it compiled once more, for that constant alone.
            signature = tuple(unliteral(each) for each in signature)  # type: ignore[no-untyped-call]
            if signature in kernel.overloads:
                return compile_now(signature)
        # numba's lock first: whoever waits for another process keeps this one's threads from waiting for each other.
        main = threading.current_thread() is threading.main_thread()
        held = _held_signals if main else contextlib.nullcontext()
        with held, global_compiler_lock, _claimed(folder, place), _no_collection():
            _progress.begin()
            before = _misses(kernel)
            entry = compile_now(signature)
            if _misses(kernel) > before:
                _progress.note(kernel)
            return entry

    kernel.compile = compile_once


@functools.cache
def _leave_scipy_out() -> None:
    """Keep numba from importing SciPy, a quarter of a second, only to see whether its linear algebra is there.

    A kernel that uses it still finds it: numba looks once more where one is compiled.
    """
    if find_spec("scipy") is None or "numba.np.arraymath" in sys.modules:
        return
    wanted = "scipy.linalg.cython_blas"
    sys.modules.setdefault(wanted, None)  # type: ignore[arg-type]
    try:
        from numba.np import arraymath
    finally:
        if sys.modules[wanted] is None:
            del sys.modules[wanted]
    arraymath._HAVE_BLAS = True


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Keep the garbage collector from looking through the whole process each time the compiler has made some objects.

    In a process that holds PyTorch that was a fifth of the time of compiling.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _misses(kernel: Any) -> int:
    """Return how often a kernel was compiled because the cache did not hold it."""
    return sum(kernel.stats.cache_misses.values())


@contextlib.contextmanager
def _claimed(folder: Path, place: int) -> Iterator[None]:
    """Hold a place among all kernels against other processes; the system gives it back when this process dies."""
    try:
        descriptor = _claims(folder)
        fcntl.lockf(descriptor, fcntl.LOCK_EX, 1, place)
    except OSError:
        # A folder that cannot be written to, or a file system without locks: compiled by everyone for themselves.
        yield
        return
    try:
        yield
    finally:
        fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, place)


@functools.cache
def _claims(folder: Path) -> int:
    """Return the descriptor of a cache's file of locks, one byte a kernel; it stays open as long as the process."""
    folder.mkdir(parents=True, exist_ok=True)
    return os.open(folder / "compiling", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
