"""Say which kernels an episode is the first to call: ``python -m tests.actors.evaluation.late_kernels NAME TASK``."""

from __future__ import annotations

import sys

from numba.core.dispatcher import Dispatcher

from actors.evaluation.settings import EvaluationSettings
from actors.evaluation.worker import Worker
from common.config import MappingConfig, TaskConfig

compile_now = Dispatcher.compile
called: list[str] = []


def note(kernel: Dispatcher, signature: object) -> object:
    """Compile or load a kernel, and note it."""
    called.append(f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}")
    return compile_now(kernel, signature)


def main(planner: str, task: str) -> None:
    """Warm up once, then run an episode in a warehouse, where the guard decides, and print the kernels that are new."""
    settings = EvaluationSettings(
        maps=("generator:warehouse?seed=5000000",),
        limit=1,
        mapping=MappingConfig(robot_radius=0.25),
        task=TaskConfig(name=task, max_steps=30),
    )
    worker = Worker(settings, lambda *_: None)
    made = settings.make(planner)
    worker.warm_up(made)
    called.clear()
    outcome = worker.attempt(made, 0)
    assert outcome.steps > 5 or outcome.success
    print(called)


if __name__ == "__main__":
    Dispatcher.compile = note
    main(*sys.argv[1:])
