"""The files of deploy/cluster: Slurm's scripts by what they do, Kubernetes' by what belongs together."""

import contextlib
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
import yaml

from tests.common.bus.processes import eventually

CLUSTER = Path(__file__).parents[3] / "deploy" / "cluster"
KUBERNETES = CLUSTER / "kubernetes"

LEARNER = """#!/bin/bash
echo "$@" >> "$STUB/calls"
mkdir -p "$HDPLANNER_RUNS/slurm/checkpoints"
trap 'mkdir -p "$HDPLANNER_RUNS/slurm/checkpoints/000000010"; exit 0' TERM
touch "$STUB/up"
while :; do sleep 0.05; done
"""
ACTOR = """#!/bin/bash
echo "$@" >> "$STUB/calls"
trap 'exit 0' TERM
while :; do sleep 0.05; done
"""
SCONTROL = """#!/bin/bash
echo scontrol "$@" >> "$STUB/calls"
"""


@pytest.fixture
def slurm(tmp_path):
    """Run a script as Slurm would, with commands in the place of ours that note how they are called."""
    for name, text in {"hd-learner": LEARNER, "hd-actor": ACTOR, "scontrol": SCONTROL}.items():
        path = tmp_path / name
        path.write_text(text)
        path.chmod(0o755)
    environment = os.environ | {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "STUB": str(tmp_path),
        "HDPLANNER_RUNS": str(tmp_path / "runs"),
        "HDPLANNER_LOOK": "0.1",
        "SLURM_JOB_ID": "7",
        "SLURM_ARRAY_JOB_ID": "8",
        "SLURM_ARRAY_TASK_ID": "3",
        "SLURM_CPUS_PER_TASK": "2",
    }
    started = []

    def start(script: str) -> subprocess.Popen:
        command = ["bash", str(CLUSTER / "slurm" / script)]
        started.append(subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True))
        return started[-1]

    yield start
    for process in started:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def calls(folder: Path) -> list[str]:
    path = folder / "calls"
    return path.read_text().splitlines() if path.exists() else []


def test_a_preempted_learner_writes_its_checkpoint_is_queued_again_and_resumes(slurm, tmp_path):
    job = slurm("learner.sbatch")
    assert eventually((tmp_path / "up").exists)
    job.send_signal(signal.SIGTERM)
    assert job.wait(20) == 0
    first, requeue = calls(tmp_path)
    assert first.startswith("start ") and "--run slurm" in first
    assert requeue == "scontrol requeue 7"
    (tmp_path / "up").unlink()
    slurm("learner.sbatch")
    assert eventually((tmp_path / "up").exists)
    assert calls(tmp_path)[-1].startswith("resume ")


def test_actors_follow_a_learner_that_moves_and_keep_their_name(slurm, tmp_path):
    endpoint = tmp_path / "runs" / "slurm.endpoint"
    endpoint.parent.mkdir()
    endpoint.write_text("tcp/first:7447\n")
    job = slurm("actors.sbatch")
    assert eventually(lambda: len(calls(tmp_path)) == 1)
    endpoint.write_text("tcp/second:7447\n")
    assert eventually(lambda: len(calls(tmp_path)) == 2)
    before, after = calls(tmp_path)
    assert "--connect tcp/first:7447" in before and "--num 2" in before
    assert after == before.replace("first", "second")
    assert "--name slurm-8-3" in after
    job.send_signal(signal.SIGTERM)
    assert job.wait(20) == 0


def documents() -> list[dict]:
    return [d for path in KUBERNETES.glob("*.yaml") for d in yaml.safe_load_all(path.read_text()) if d is not None]


def test_the_parts_of_the_kustomization_fit_each_other():
    kustomization = yaml.safe_load((KUBERNETES / "kustomization.yaml").read_text())
    assert sorted(kustomization["resources"]) == sorted(
        path.name for path in KUBERNETES.glob("*.yaml") if path.name != "kustomization.yaml"
    )
    found = {(each["kind"], each.get("metadata", {}).get("name")): each for each in documents()}
    services = {name: each for (kind, name), each in found.items() if kind == "Service"}
    workloads = {n: e for (k, n), e in found.items() if k in ("Deployment", "StatefulSet")}
    assert workloads.keys() == {"learner", "actors", "evaluator", "router"}
    images = {each["name"] for each in kustomization["images"]}
    for name, workload in workloads.items():
        labels = workload["spec"]["template"]["metadata"]["labels"]
        assert workload["spec"]["selector"]["matchLabels"] == labels, name
        assert workload["spec"]["template"]["spec"]["securityContext"]["runAsNonRoot"]
        for container in workload["spec"]["template"]["spec"]["containers"]:
            assert container["image"] in images
            assert container["resources"].keys() == {"requests", "limits"}
            words = " ".join([*container.get("command", []), *container.get("args", [])])
            for host, port in re.findall(r"tcp/([a-z]+):(\d+)", words):
                assert int(port) in [each["port"] for each in services[host]["spec"]["ports"]], words
    for name, service in services.items():
        ports = {p["containerPort"] for p in workloads[name]["spec"]["template"]["spec"]["containers"][0]["ports"]}
        assert {each["port"] for each in service["spec"]["ports"]} <= ports
    scaler = found["HorizontalPodAutoscaler", "actors"]["spec"]
    assert scaler["scaleTargetRef"]["name"] in workloads
    # What an autoscaler sets, the deployment does not: each apply would scale back.
    assert "replicas" not in workloads["actors"]["spec"]


def test_every_command_of_the_cluster_files_has_its_options():
    from typer.main import get_command

    from actors.cli import app as actor
    from learner.cli import app as learner

    known = {"hd-actor": {None: get_command(actor)}, "hd-learner": get_command(learner).commands}
    checked = 0
    for path in [*KUBERNETES.glob("*.yaml"), *CLUSTER.glob("slurm/*")]:
        lines = [
            line for line in path.read_text().replace("\\\n", " ").splitlines() if not line.strip().startswith("#")
        ]
        for line in lines:
            words = re.sub(r'[\[\],"]', " ", line)
            for command, verb, rest in re.findall(r"\b(hd-actor|hd-learner) +(?:([a-z]+)\b|\$\w+)?(.*)", words):
                options = known[command].get(verb or None) or known[command].get("start")
                named = {name for parameter in options.params for name in parameter.opts}
                used = set(re.findall(r"(?<!\S)--[a-z-]+", rest))
                assert used <= named, (path.name, used - named)
                checked += len(used)
    assert checked > 10
