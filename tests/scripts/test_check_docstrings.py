import subprocess
import sys

import pytest

from tests.common.bus.processes import ROOT

FUNCTION = '''"""Module."""


def half(whole: int, parts: int) -> float:
    """Return a share.

    Args:
        {arguments}: of a thing.
    """
    return whole / parts
'''


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [("whole", 0, ""), ("hole", 1, "half.py:4: DOC103: Function `half`: ")],
    ids=["one that is left out", "one that is not there"],
)
def test_a_docstring_may_leave_arguments_out_but_not_name_others(tmp_path, arguments, code, words):
    (tmp_path / "half.py").write_text(FUNCTION.format(arguments=arguments))
    done = subprocess.run(
        [sys.executable, "scripts/check_docstrings.py", str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (code, "")
    assert words in done.stdout
    assert done.stdout or not words


def test_a_file_that_cannot_be_read_is_no_success(tmp_path):
    (tmp_path / "half.py").write_text("def half(")
    done = subprocess.run(
        [sys.executable, "scripts/check_docstrings.py", str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode != 0
    assert "half.py" in done.stdout + done.stderr
