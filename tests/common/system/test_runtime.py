"""Process set-up: malloc and Zenoh settings reach the process, and a user's own values win."""

import os
import subprocess
import sys

import pytest

from common.system.runtime import MALLOC_SETTINGS, cores_left, process_environment, python_module


def test_the_users_own_values_win():
    environment = process_environment({"MALLOC_TOP_PAD_": "7", "HOME": "/x"}, threads=1)
    assert environment["MALLOC_TOP_PAD_"] == "7"
    assert environment["OMP_NUM_THREADS"] == "1"
    assert environment["HOME"] == "/x"
    assert set(MALLOC_SETTINGS) <= set(environment)
    assert environment["OMP_WAIT_POLICY"] == "PASSIVE"
    assert process_environment({"OMP_WAIT_POLICY": "ACTIVE"})["OMP_WAIT_POLICY"] == "ACTIVE"


def test_companions_leave_at_least_one_core():
    assert cores_left(1_000) == 1
    assert cores_left(0) == max(1, cores_left(1) + (cores_left(0) > 1))


def test_a_command_restarts_itself_once_and_keeps_its_arguments():
    code = (
        "import os, sys; from common.system.runtime import restart_prepared; restart_prepared(); "
        "print(os.environ['MALLOC_TRIM_THRESHOLD_'], sys.argv[1:])"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MALLOC_", "HD_"))}
    done = subprocess.run(
        [sys.executable, "-c", code, "a b", "--c"], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.split("\n")[0] == f"{MALLOC_SETTINGS['MALLOC_TRIM_THRESHOLD_']} ['a b', '--c']"


@pytest.mark.parametrize("package", ["common", "actors", "learner", "deploy"])
def test_a_folder_with_packages_of_our_names_does_not_hide_ours(tmp_path, package):
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").write_text("raise SystemExit('foreign code')")
    command = python_module("common.system.tethered", str(os.getpid()), *python_module(package, "--help"))
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert "foreign code" not in run.stderr
