"""The scripts of deploy/cluster/slurm under a real Slurm of one node, with real learner and actors."""

import os
import socket
import sys
from pathlib import Path

import pytest

from tests.common.bus.processes import eventually
from tests.deploy.cluster.slurm import missing, slurm_here

SCRIPTS = Path(__file__).parents[3] / "deploy" / "cluster" / "slurm"
SMALL = (
    "--preset workstation --sim grid --set maps.train=generator:rooms?width=256&height=192 "
    "--set network.width=16 --set network.heads=2 --set network.layers=1 --set replay.min_steps=32 "
    "--set learner.batch_size=8"
)


@pytest.fixture
def cluster(tmp_path):
    if why := missing():
        pytest.skip(why)
    with slurm_here(tmp_path) as found:
        yield found


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_learner_and_its_actors_train_on_a_cluster_and_survive_preemption(cluster, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    settings = {"HDPLANNER_RUN": "office", "HDPLANNER_RUNS": str(tmp_path / "runs"), "HDPLANNER_PORT": port}
    # The commands of this checkout, installed or not.
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, module in (("hd-learner", "learner"), ("hd-actor", "actors")):
        (commands / name).write_text(f'#!/bin/bash\nexec {sys.executable} -P -m {module} "$@"\n')
        (commands / name).chmod(0o755)
    settings["PATH"] = f"{commands}:{os.environ['PATH']}"
    small = ("--cpus-per-task=2", "--mem=1G")
    learner = cluster.submit(SCRIPTS / "learner.sbatch", *small, **settings, HDPLANNER_OPTIONS=SMALL)
    actors = cluster.submit(
        SCRIPTS / "actors.sbatch", *small, "--array=0-1", **settings, HDPLANNER_ACTOR_OPTIONS="--sim grid"
    )
    episodes = tmp_path / "runs" / "office" / "episodes.jsonl"

    def counted():
        return episodes.exists() and episodes.stat().st_size > 0

    assert eventually(lambda: {cluster.state(learner), *cluster.state(actors).split()} == {"RUNNING"}, 60)
    assert eventually(lambda: counted() or "error:" in log(tmp_path, learner), 300)
    assert counted(), log(tmp_path, learner)
    # Preemption, as Slurm does it for a job that may be queued again: SIGTERM to the script.
    cluster.run("scancel", "--batch", "--signal=TERM", learner)
    assert eventually(lambda: "the job goes back into the queue" in log(tmp_path, learner), 120)
    assert eventually(lambda: "resumed run office" in log(tmp_path, learner), 180)
    assert eventually(lambda: cluster.state(learner) == "RUNNING", 30)
    # The actors found it again.
    before = episodes.stat().st_size
    assert eventually(lambda: episodes.stat().st_size > before, 180), log(tmp_path, learner)


def log(folder: Path, job: str) -> str:
    path = folder / f"hd-learner-{job}.log"
    return path.read_text() if path.exists() else ""
