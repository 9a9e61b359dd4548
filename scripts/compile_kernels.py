"""Compile what actors, learners, evaluations and robots call, in two processes: ``python scripts/compile_kernels.py``.

The halves meet little: one begins with mapping and worlds, the other one with networks and messages. What both need is
compiled by the one that comes to it first (`common.system.jit`).
"""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from common.planners.base import Planner


def acting() -> None:
    """Prepare an actor."""
    from actors.warmup import warm_up
    from common.config import NetworkConfig

    warm_up(NetworkConfig())


def deciding() -> None:
    """Prepare a learner, the planners of an evaluation, a robot, and an actor of a guided policy."""
    import torch

    from actors.warmup import warm_up as warm_up_actor
    from common.config import NetworkConfig, RunConfig
    from deploy.bridge.warmup import warm_up as warm_up_bridge
    from deploy.config import DeployConfig
    from learner.warmup import warm_up as warm_up_learner

    warm_up_learner(RunConfig(), torch.device("cpu"))
    planners = []
    for task in ("exploration", "navigation"):
        planners += [(planner, task) for planner in _planners(task)]
    config = DeployConfig.model_validate({"driving": {"enabled": True}})
    warm_up_bridge(config, planners)
    warm_up_actor(NetworkConfig(features="guided", graph="reduced"))


def _planners(task: str) -> list[Planner]:
    """Let all planners of a task decide in a small world, and return them."""
    from actors.evaluation.omniscient import NAME
    from actors.evaluation.settings import EvaluationSettings
    from actors.evaluation.worker import Worker
    from common.errors import HDError
    from common.planners.registry import planner_names

    settings = EvaluationSettings(maps=("generator:rooms",), task={"name": task})
    worker = Worker(settings, lambda *_: None)
    made = []
    for name in planner_names(task, task):
        try:
            made.append(settings.make(name))
        except HDError as error:
            sys.stderr.write(f"without planner {name}: {error}\n")
            continue
        worker.warm_up(made[-1])
    worker.warm_up(settings.make(NAME))
    worker.close()
    return made


HALVES = {"acting": acting, "deciding": deciding}


def main() -> int:
    """Run both halves; the exit code tells whether they succeeded."""
    if len(sys.argv) > 1:
        HALVES[sys.argv[1]]()
        return 0
    started = [subprocess.Popen([sys.executable, __file__, half]) for half in HALVES]
    codes = [process.wait() for process in started]
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
