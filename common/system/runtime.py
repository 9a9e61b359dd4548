"""Settings of a whole process that must be made before the work starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping

# Training allocates and frees the same large tensors in every step. With glibc's defaults each of them is mapped
# from and returned to the system, and the page faults cost a third of the time (docs/design.md,
# "Memory and threads of the processes").
MALLOC_SETTINGS = {
    "MALLOC_MMAP_THRESHOLD_": str(1 << 30),
    "MALLOC_TRIM_THRESHOLD_": str(1 << 31),
    "MALLOC_TOP_PAD_": str(64 << 20),
}

# Threads of OpenMP that wait for work spin by default, and take the cores from the actors beside them: without this a
# shared machine makes 1.9 to 4.4 times fewer updates (docs/design.md, "Memory and threads of the processes").
OPENMP_SETTINGS = {"OMP_WAIT_POLICY": "PASSIVE"}

# Two threads receive everything by default, so two busy clients could freeze a session (docs/design.md, "Zenoh").
ZENOH_SETTINGS = {"ZENOH_RUNTIME": "(rx: (worker_threads: 8))"}

_MARK = "HD_PROCESS_PREPARED"


def process_environment(base: Mapping[str, str] | None = None, *, threads: int | None = None) -> dict[str, str]:
    """Return the environment of a process that trains or acts; values that a user has set win.

    Args:
        base: the environment to build upon, this process's own by default.
        threads: threads of the numerical libraries; None leaves them alone.
    """
    environment = dict(os.environ if base is None else base)
    for name, value in {**MALLOC_SETTINGS, **OPENMP_SETTINGS, **ZENOH_SETTINGS}.items():
        environment.setdefault(name, value)
    if threads is not None:
        for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
            environment[name] = str(threads)
    return environment


def python_module(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of this package in a process of its own.

    ``-P`` keeps the current folder off the module path: a user's folder may hold a package called `common`.
    """
    return [sys.executable, "-P", "-m", module, *arguments]


def restart_prepared() -> None:
    """Replace this process by itself with malloc, OpenMP and Zenoh set up, once; return at once when that is done.

    glibc reads its thresholds, OpenMP how to wait, and Zenoh its runtime only when the process starts, so a command
    calls this first.
    """
    if os.environ.get(_MARK) or not sys.platform.startswith("linux"):
        return
    environment = process_environment()
    environment[_MARK] = "1"
    os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environment)


def allow_files(wanted: int) -> None:
    """Let this process have so many files and connections open, or as many as its user may."""
    if sys.platform == "win32":
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def cores_left(companions: int) -> int:
    """Return the cores that this process may use beside so many busy processes of one thread each, at least 1."""
    cores = len(os.sched_getaffinity(0)) if sys.platform.startswith("linux") else os.cpu_count() or 1
    return max(1, cores - companions)


def limit_threads(threads: int) -> None:
    """Bound the threads of torch and numba in this process; 0 leaves all cores to them."""
    import numba
    import torch

    if threads > 0:
        # numba first: starting its OpenMP layer sets the number of threads that torch reads.
        numba.set_num_threads(min(threads, numba.get_num_threads()))
        torch.set_num_threads(threads)
