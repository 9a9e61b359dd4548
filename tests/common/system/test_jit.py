"""Compiled kernels follow the sources, also through calls from one module into another."""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
INNER = "from common.system.jit import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
OUTER = (
    "from common.system.jit import njit\nfrom common.inner import inner\n\n"
    "@njit(cache=True)\ndef outer(x):\n    return inner(x)\n"
)


def test_a_change_of_a_called_kernel_reaches_its_callers(tmp_path):
    package = tmp_path / "common"
    (package / "system").mkdir(parents=True)
    for name in ("__init__.py", "system/__init__.py", "system/jit.py"):
        shutil.copy(ROOT / "common" / name, package / name)
    (package / "outer.py").write_text(OUTER)

    def answer() -> str:
        done = subprocess.run(
            [sys.executable, "-c", "from common.outer import outer; print(outer(1))"],
            cwd=tmp_path,
            env={"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    (package / "inner.py").write_text(INNER.format(1))
    assert answer() == answer() == "2"
    assert len(list((tmp_path / "cache" / "hdplanner" / "kernels").iterdir())) == 1
    (package / "inner.py").write_text(INNER.format(10))
    assert answer() == "11"
