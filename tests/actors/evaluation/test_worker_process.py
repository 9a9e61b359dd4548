import json
import subprocess
import sys

import psutil

from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worker_process import WORKER, WorkerProcesses

LIGHT = """
import sys
import actors.evaluation.worker_process
print(*({"numba", "numpy", "pydantic"} & set(sys.modules)))
"""


def workers():
    return [child for child in psutil.Process().children(recursive=True) if WORKER in child.cmdline()]


def test_a_process_that_is_prepared_takes_its_settings_later():
    with WorkerProcesses() as processes:
        processes.prepare()
        (prepared,) = workers()
        settings = EvaluationSettings(maps=("generator:rooms?width=192&height=192",), limit=1)
        process = processes.start(settings.model_dump_json())
        assert process.pid == prepared.pid
        assert json.loads(process.stdout.readline()) == {"event": "ready", "value": None}
        process.stdin.close()
        assert process.wait(30) == 0
        process.stdout.close()


def test_a_process_that_is_not_needed_leaves_with_the_command():
    with WorkerProcesses() as processes:
        processes.prepare()
        (prepared,) = workers()
    assert not prepared.is_running()


def test_starting_one_imports_nothing_that_takes_long():
    assert subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True).stdout == "\n"
