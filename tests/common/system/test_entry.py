"""How commands begin: help comes at once, and signals are heard from the first moment."""

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.common.system.test_extras import OPTIONAL

SCRIPTS = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]
# What comes with an extra, or takes long to import, cannot be imported here.
HELP = f"""
import importlib, sys
for name in {["numba", "numpy", "zenoh", *OPTIONAL]!r}:
    sys.modules[name] = None
import typer
apps = [importlib.import_module(entry.replace("__main__:main", "cli")).app for entry in sys.argv[1:]]
print("metadata of packages:", "importlib.metadata" in sys.modules)
for entry, app in zip(sys.argv[1:], apps):
    command = typer.main.get_command(app)
    for path in ([], *([name] for name in getattr(command, "commands", ()))):
        command.main([*path, "--help"], prog_name=entry, standalone_mode=False)
    print("ours:", *(name for name in sys.modules if name.startswith("common.config")))
print("rich:", *(name for name in sys.modules if name.startswith("rich")))
"""
# A shell lets what it runs in the background ignore SIGINT; in a terminal it is heard.
BEGUN = """
import signal, time
from common.system.entry import ended_by_signals
signal.signal(signal.SIGINT, signal.default_int_handler)
with ended_by_signals():
    print("importing", flush=True)
    time.sleep(60.0)
"""
THREADS = """
from common.system.entry import ended_by_signals
with ended_by_signals():
    import numpy, threadpoolctl
    print(*(each["num_threads"] for each in threadpoolctl.threadpool_info()))
"""


def test_help_needs_no_extra_and_imports_nothing_that_takes_long():
    assert all(entry.endswith(".__main__:main") for entry in SCRIPTS.values())
    told = subprocess.run([sys.executable, "-c", HELP, *SCRIPTS.values()], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    assert "metadata of packages: False\n" in told.stdout
    # It formats help in twice the time.
    assert told.stdout.endswith("rich:\n")
    # The sections of the configuration are models that take a fifth of a second to build.
    assert told.stdout.count("ours:\n") == len(SCRIPTS), told.stdout
    assert told.stdout.count("Usage:") > 40


@pytest.mark.parametrize(
    ("number", "status", "line"), [(signal.SIGINT, 130, "interrupted\n"), (signal.SIGTERM, 143, "terminated\n")]
)
def test_a_signal_ends_a_command_that_still_imports_in_one_line(number, status, line):
    process = subprocess.Popen([sys.executable, "-c", BEGUN], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with process:
        assert process.stdout.readline() == "importing\n"
        process.send_signal(number)
        assert process.stderr.read() == line
    assert process.returncode == status


@pytest.mark.parametrize(("chosen", "threads"), [(None, "1"), ("2", "2")])
def test_products_of_a_command_take_one_thread_unless_its_user_says_otherwise(chosen, threads):
    numerical = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {name: value for name, value in os.environ.items() if name not in numerical}
    environment |= {} if chosen is None else {"OPENBLAS_NUM_THREADS": chosen}
    told = subprocess.run([sys.executable, "-c", THREADS], capture_output=True, text=True, check=True, env=environment)
    assert told.stdout == f"{threads}\n"


CLOSED = """
import os, subprocess, sys
from common.system.entry import ended_by_signals
with ended_by_signals():
    for stream in (sys.stdout, sys.stderr):
        print("to nobody", file=stream, flush=True)
    with open(sys.argv[1], "w") as file:
        os.write(2, b"terminated")
        subprocess.run([sys.executable, "-c", "import sys; print(1, file=sys.stderr)"], check=True)
        file.write("whole")
"""


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_streams_that_were_closed_lead_nowhere(tmp_path, closed):
    path = tmp_path / "journal"
    done = subprocess.run(["sh", "-c", f'exec "$0" -c "$1" "$2" {closed}', sys.executable, CLOSED, str(path)])
    assert done.returncode == 0
    assert path.read_text() == "whole"
