"""The regret of policies, as its page calls the program."""

import subprocess
import sys


def regret(*words):
    return subprocess.run([sys.executable, "-m", "benchmarks.regret", *words], capture_output=True, text=True)


def test_what_ships_is_named_by_its_task():
    told = regret("exploration", "--worlds", "1", "--steps", "2")
    assert told.returncode == 0, told.stderr
    _, families, row = told.stdout.splitlines()
    assert "office, 2" in families
    assert row.startswith("exploration ")
    assert row.count("(0.00)") == 4


def test_a_policy_that_is_not_there_is_an_error_in_one_line():
    told = regret("nowhere.safetensors")
    assert told.returncode == 1
    assert told.stderr.startswith("error: cannot read the policy nowhere.safetensors")
    assert "Traceback" not in told.stderr
