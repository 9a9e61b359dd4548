"""Say which kernels a robot is the first to call: ``python -m tests.deploy.bridge.late_kernels``."""

from __future__ import annotations

from numba.core.dispatcher import Dispatcher

from deploy.bridge.planner_selector import make_planners
from deploy.bridge.warmup import warm_up
from tests.deploy.recording.world import config, explore

compile_now = Dispatcher.compile
called: list[str] = []


def note(kernel: Dispatcher, signature: object) -> object:
    """Compile or load a kernel, and note it."""
    called.append(f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}")
    return compile_now(kernel, signature)


def main() -> None:
    """Prepare as the bridge does, explore two rooms where the guard decides, and print the kernels that are new."""
    settings = config()
    planners = make_planners(settings)
    warm_up(settings, planners.members(settings.decision.task))
    called.clear()
    explore(settings)
    print([name for name in called if name.startswith(("common.", "deploy."))])


if __name__ == "__main__":
    Dispatcher.compile = note
    main()
