"""Which extras resolve to ready-made wheels on which CPython, on Linux x86_64; prints a Markdown table.

It asks pip's own resolver (``pip install --dry-run --only-binary :all:``) for each extra and each Python, and installs
nothing. Machines without those interpreters can so check them::

    python scripts/check_wheels.py                     # the Pythons of pyproject.toml
    python scripts/check_wheels.py --python 3.13 --extra robot
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
PLATFORMS = ("manylinux_2_35_x86_64", "manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64")


def requirements(extra: str | None, extras: dict[str, list[str]], core: list[str]) -> list[str]:
    """Return what an extra installs, with what every process needs; None stands for the latter alone."""
    return core if extra is None else [*core, *extras[extra]]


def problem(python: str, wanted: list[str]) -> str:
    """Return the first package without a wheel for a Python, or an empty string where all have one."""
    kept = [line for line in wanted if applies(line, python)]
    platforms = [word for platform in PLATFORMS for word in ("--platform", platform)]
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--disable-pip-version-check"),
            *("--ignore-installed", "--only-binary", ":all:", "--target", folder),
            *("--python-version", python, "--implementation", "cp", *platforms, *kept),
        ]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode == 0:
        return ""
    found = re.search(r"No matching distribution found for ([^\s;]+)|requirement ([^\s;(]+)", result.stderr)
    return (found[1] or found[2]) if found else _last_word(result.stderr)


def _last_word(output: str) -> str:
    lines = [line for line in output.splitlines() if line.strip() and not line.startswith("WARNING")]
    return lines[-1] if lines else "pip failed and says nothing"


def applies(requirement: str, python: str) -> bool:
    """Tell whether a requirement's marker holds: pip reads markers by the Python that it runs on itself."""
    bound = re.search(r"python_version\s*<\s*['\"]([\d.]+)['\"]", requirement)
    return bound is None or _numbers(python) < _numbers(bound[1])


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def main() -> int:
    """Print the table; the exit code is 1 when something has no wheel."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", action="append", metavar="X.Y", help=f"default: {', '.join(PYTHONS)}")
    parser.add_argument("--extra", action="append", metavar="NAME", help="default: all")
    options = parser.parse_args()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = {
        name: wanted
        for name, wanted in project["optional-dependencies"].items()
        # Those that gather others say nothing new.
        if not any(each.startswith(project["name"] + "[") for each in wanted)
    }
    pythons = options.python or list(PYTHONS)
    failed = False
    sys.stdout.write(f"| extra | {' | '.join(pythons)} |\n| --- |{' --- |' * len(pythons)}\n")
    for extra in options.extra or [None, *extras]:
        cells = []
        for python in pythons:
            wanted = requirements(extra, extras, project["dependencies"])
            left_out = [re.split(r"[\s<>=;]", line)[0] for line in wanted if not applies(line, python)]
            missing = problem(python, wanted)
            failed |= bool(missing)
            cells.append(f"no wheel: {missing}" if missing else f"without {', '.join(left_out)}" if left_out else "yes")
        sys.stdout.write(f"| {'(none)' if extra is None else f'`{extra}`'} | {' | '.join(cells)} |\n")
        sys.stdout.flush()
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
