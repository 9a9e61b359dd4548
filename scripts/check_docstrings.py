"""Check docstrings against signatures: ``python scripts/check_docstrings.py PATH ...``; exit code 1 if one is wrong.

A docstring may leave out arguments whose names say it all, but must not document what the signature lacks. pydoclint
has no selection of its own, and through flake8 it takes three times as long. Its settings are in pyproject.toml.
"""

from __future__ import annotations

import re
import subprocess
import sys
from typing import Final

# A file that cannot be read; too many arguments, another order, a section too many; a name that is not there.
_SELECTED: Final = re.compile(r"DOC002|DOC102|DOC104|DOC202|DOC403|in the docstring but not in the function signature")
_LINE: Final = re.compile(r"\s+(\d+: .*)")


def main(folders: list[str]) -> int:
    """Run pydoclint and show what counts."""
    command = [sys.executable, "-m", "pydoclint.main", "--quiet", *folders]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    report = done.stdout + done.stderr
    # It fails for any finding; without one in its report it has not done its work.
    if done.returncode and not re.search(r"^\s+\d+: DOC\d", report, re.MULTILINE):
        sys.stderr.write(report)
        return 2
    wrong, file = [], ""
    for line in report.splitlines():
        found = _LINE.fullmatch(line)
        if found is None:
            file = line or file
        elif _SELECTED.search(found[1]):
            wrong.append(f"{file}:{found[1]}")
    sys.stdout.write("".join(f"{each}\n" for each in wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
