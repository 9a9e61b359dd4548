"""Resident memory of each process of a run: ``python -m benchmarks.memory``.

A learner with the paper's sizes and two local PyBullet actors train for a while; then each process is asked.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

MEGABYTE = 1e6
SETTINGS = ["learner.updates_per_step=0.02", "replay.min_steps=200", "replay.capacity=100000"]


def run(updates: int = 5, patience: float = 400.0) -> dict[str, float]:
    """Return megabytes by process after some updates; kernels that must be compiled first take their time."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{found.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as folder:
        settings = [part for setting in SETTINGS for part in ("--set", setting)]
        command = [sys.executable, "-m", "learner", "start", "--actors", "2", "--runs", folder, "--listen", endpoint]
        learner = subprocess.Popen(
            [*command, *settings], cwd=Path(__file__).parents[1], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            status: dict[str, float] = {"updates": 0, "replay": 0}
            end = time.monotonic() + patience
            while status["updates"] < updates and time.monotonic() < end:
                time.sleep(2.0)
                status = _status(endpoint) or status
            figures = _resident(learner.pid)
            figures["transitions in the replay buffer"] = float(status["replay"])
            figures["updates made"] = float(status["updates"])
        finally:
            learner.send_signal(signal.SIGINT)
            try:
                learner.wait(30)
            except subprocess.TimeoutExpired:
                learner.kill()
                learner.wait()
    return figures


def _status(endpoint: str) -> dict[str, float] | None:
    ask = [sys.executable, "-m", "learner", "status", "--connect", endpoint, "--json"]
    done = subprocess.run(ask, capture_output=True, check=False)
    return json.loads(done.stdout) if done.returncode == 0 else None


def _resident(pid: int) -> dict[str, float]:
    process = psutil.Process(pid)
    figures = {"learner MB": process.memory_info().rss / MEGABYTE}
    actors = 0
    for child in process.children(recursive=True):
        line = " ".join(child.cmdline())
        resident = child.memory_info().rss / MEGABYTE
        if "actors.process" in line:
            figures[f"actor {actors} MB"] = resident
            actors += 1
        elif "actors --num" in line and "tethered" not in line:
            figures["supervisor of the actors MB"] = resident
        else:
            figures[f"{line.split()[2] if len(line.split()) > 2 else line} MB"] = resident
    return figures


if __name__ == "__main__":
    for name, value in run().items():
        print(f"{name:<50} {value:10.0f}")
