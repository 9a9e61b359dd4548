"""Compiled kernels follow the sources, also through calls from one module into another."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
INNER = "from common.system.jit import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
OUTER = (
    "from common.system.jit import njit\nfrom common.inner import inner\n\n"
    "@njit(cache=True)\ndef outer(x):\n    return inner(x) + inner(0) - inner(0)\n"
)
IMPORT = "from common.outer import inner, outer; print(outer(1))"


def start(folder, after="") -> subprocess.Popen:
    """Run the outer kernel in a process of its own."""
    program = (
        f"import logging; logging.basicConfig(level='INFO', format='%(message)s', filename='log')\n{IMPORT}{after}"
    )
    environment = {"XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", program]
    return subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)


def told(process) -> str:
    with process:
        out = process.stdout.read()
    assert process.returncode == 0
    return out.strip()


def test_processes_share_what_one_compiles_and_a_change_of_a_called_kernel_reaches_its_callers(tmp_path):
    package = tmp_path / "common"
    (package / "system").mkdir(parents=True)
    for name in (
        "__init__.py",
        "system/__init__.py",
        "system/jit.py",
        "system/kernel_cache.py",
        "system/kernel_folders.py",
    ):
        shutil.copy(ROOT / "common" / name, package / name)
    (package / "outer.py").write_text(OUTER)
    (package / "inner.py").write_text(INNER.format(1))

    # Two that start together: each kernel is compiled in one of them, and loaded in the other.
    misses = "; print(*(sum(kernel.stats.cache_misses.values()) for kernel in (inner, outer)))"
    together = [start(tmp_path, misses) for _ in range(2)]
    answers = [told(process).split() for process in together]
    assert [answer[0] for answer in answers] == ["2"] * 2
    assert sum(int(answer[2]) for answer in answers) == 1, "outer"
    assert sum(int(answer[1]) for answer in answers) <= 1, "inner, also for the constant"
    assert len(list((tmp_path / "cache" / "hdplanner" / "kernels").iterdir())) == 1

    log = tmp_path / "log"
    # Whoever compiles says so.
    assert log.read_text().count("compiling kernels") in (1, 2)
    log.unlink()
    assert told(start(tmp_path)) == "2"
    assert log.read_text() == ""

    (package / "inner.py").write_text(INNER.format(10))
    assert told(start(tmp_path)) == "11"
    assert "compiling kernels" in log.read_text()


INTERRUPTED = """
import os, signal
from numba.core import codegen
from common.system.entry import ended_by_signals
from common.system.jit import njit

class_ = codegen.CPUCodeLibrary
told = class_._object_compiled_hook.__func__

def hook(*arguments):
    os.kill(os.getpid(), signal.SIGTERM)
    return told(*arguments)

class_._object_compiled_hook = classmethod(hook)

@njit(cache=True)
def inner(x):
    return x + 1

@njit(cache=True)
def outer(x):
    return inner(x)

with ended_by_signals():
    try:
        outer(1)
    finally:
        second = signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        print(*(len(kernel.overloads) for kernel in (inner, outer)), second, flush=True)
"""


def test_a_signal_in_the_midst_of_compiling_is_heard_when_that_kernel_is_done(tmp_path):
    (tmp_path / "program.py").write_text(INTERRUPTED)
    environment = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "program.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (143, "1 0 True\n", "terminated\n")


ALGEBRA = """
import sys
import numpy as np
from common.system.jit import njit

@njit(cache=True)
def twice(x):
    return 2.0 * x

@njit(cache=True)
def product(x):
    return np.dot(x, x)

twice(1.0)
print("scipy.linalg" in sys.modules)
print(product(np.eye(2))[0, 0])
"""


def test_linear_algebra_is_imported_for_a_kernel_that_needs_it_alone(tmp_path):
    pytest.importorskip("scipy", reason="SciPy is not installed")
    (tmp_path / "program.py").write_text(ALGEBRA)
    environment = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "program.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == "False\n1.0\n", done.stderr


KEPT = """
import builtins, errno, logging, os, sys
from pathlib import Path
logging.basicConfig(format="%(message)s", stream=sys.stdout)
from common.system import kernel_cache
from common.system.jit import njit
from common.system.kernel_folders import cache_folder, forget_old_caches

def twice(x):
    return 2 * x

def call():
    kernel_cache._said.clear()
    forget_old_caches()
    kernel = njit(cache=True)(twice)
    print(kernel(1), sum(kernel.stats.cache_hits.values()), flush=True)

def refusing(function, writes):
    def checked(path, *arguments, **named):
        if "/cache/" in f"{path}/" and writes(*arguments):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return function(path, *arguments, **named)
    return checked

call()
for ending in ("nbi", "nbc"):
    for content in (b"", bytes(3000)):
        [path] = Path(os.environ["XDG_CACHE_HOME"]).rglob(f"*.{ending}")
        path.write_bytes(content)
        call()
# As on a read-only file system, to root too.
builtins.open = refusing(builtins.open, lambda mode="r", *_: not set(mode).isdisjoint("wax+"))
os.open = refusing(os.open, lambda flags, *_: flags & (os.O_WRONLY | os.O_RDWR))
os.utime = refusing(os.utime, lambda *_: True)
call()
# Below a file no folder can be made.
os.environ["XDG_CACHE_HOME"] = "file"
cache_folder.cache_clear()
call()
"""


def test_a_cache_that_is_damaged_or_cannot_be_written_to_ends_nothing(tmp_path):
    (tmp_path / "program.py").write_text(KEPT)
    (tmp_path / "file").touch()
    environment = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "program.py"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    fresh, *damaged, read_only, lost, without = done.stdout.splitlines()
    assert fresh == without == "2 0"
    assert read_only == "2 1", "what it holds is read"
    assert damaged[1::2] == ["2 0"] * 4
    assert all(line.startswith(f"damaged kernels in {tmp_path / 'cache'}") for line in damaged[::2])
    assert lost.startswith("compiled kernels cannot be kept in file/")
    assert "Not a directory" in lost
    # Beside the sources a kernel would not follow those that it calls.
    assert not (tmp_path / "__pycache__").exists()
