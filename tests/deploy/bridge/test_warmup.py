"""What a robot prepares before it depends on the time of a decision."""

import subprocess
import sys


def test_an_exploration_compiles_nothing_on_its_way():
    # In a process of its own: here other tests may have called the kernels.
    command = [sys.executable, "-m", "tests.deploy.bridge.late_kernels"]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stdout == "[]\n"
