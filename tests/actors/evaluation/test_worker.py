"""What a worker of an evaluation prepares before its first episode."""

from __future__ import annotations

import subprocess
import sys

import pytest

from common.system.runtime import process_environment


@pytest.mark.slow
@pytest.mark.parametrize(("planner", "task"), [("hdplanner", "exploration"), ("hdplanner", "navigation")])
def test_an_episode_calls_no_kernel_that_was_not_prepared(planner: str, task: str) -> None:
    """Not those of the guard's planners either: one that compiles takes longer than a decision may."""
    command = [sys.executable, "-m", "tests.actors.evaluation.late_kernels", planner, task]
    done = subprocess.run(command, env=process_environment(threads=1), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
