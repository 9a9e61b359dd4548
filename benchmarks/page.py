"""What the pages cost: their processes at 0, 1 and 10 browsers, bytes to each, and how late a control loop comes.

A robot's node speaks on the topics as a bridge and its robot do (status 2 Hz, belief, scene and path 1 Hz, odometry
20 Hz, scan 10 Hz, a building of 130 m x 100 m that is explored as it goes) and keeps a loop of 20 Hz. Its page runs as
a process of its own, the browsers are WebSocket clients in a third process. The loop without a page and beside one of
ten browsers is measured in turns, within one run. The page of a training belongs to a run of 16 actors, one of which
every browser looks at.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.children import child_environment
from benchmarks.page_rigs import Run, Speaker
from common.page.options import PageSettings
from common.page.process import PageProcess
from common.system.runtime import python_module
from deploy.page.process import start_page as start_robots_page
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import free_endpoint
from learner.page.process import start_page as start_training_page

SECONDS: Final = float(os.environ.get("HD_BENCH_SECONDS", "12"))
_COUNTS: Final = (0, 1, 10)
_TURNS: Final = 3
_SETTLE_SECONDS: Final = 2.0
_ACTORS: Final = 16


def run(
    seconds: float = SECONDS, counts: Sequence[int] = _COUNTS, turns: int = _TURNS, actors: int = _ACTORS
) -> dict[str, float]:
    """Measure and return the figures by name.

    Args:
        seconds: of each measurement.
        counts: of browsers.
        turns: of the loop without a page and beside one.
        actors: of the training.
    """
    return {**_robots(seconds, counts, turns), **_training(seconds, counts, actors)}


def _robots(seconds: float, counts: Sequence[int], turns: int) -> dict[str, float]:
    endpoint = free_endpoint()
    config = load_deploy_config(None, ["ros.connect=", f"ros.listen={endpoint}"], profile="bare")
    speaker = Speaker(config)
    found: dict[str, float] = {}
    late: dict[str, list[float]] = {"without a page": [], "with ten browsers": []}
    try:
        with start_robots_page(PageSettings(0), config) as page:
            time.sleep(_SETTLE_SECONDS)
            for count in counts:
                found |= _measure("robots", page, count, ["*"], seconds)
        for _ in range(turns):
            speaker.late.clear()
            time.sleep(seconds)
            late["without a page"] += speaker.late
            with start_robots_page(PageSettings(0), config) as page:
                time.sleep(_SETTLE_SECONDS)
                speaker.late.clear()
                _measure("robots", page, max(counts), ["*"], seconds)
                late["with ten browsers"] += speaker.late
    finally:
        speaker.close()
    for name, delays in late.items():
        for label, share in (("half", 0.5), ("95 %", 0.95)):
            found[f"loop of 20 Hz {name}: {label} no later than, ms"] = 1e3 * float(np.quantile(delays, share))
    return found


def _training(seconds: float, counts: Sequence[int], actors: int) -> dict[str, float]:
    training = Run(actors)
    found: dict[str, float] = {}
    channels = ["run", "status", "actors", "curve-*", "evaluations", "world/*", f"actor/{training.watched}/*"]
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            start_training_page(PageSettings(0), training.config, Path(folder)) as page,
        ):
            time.sleep(_SETTLE_SECONDS)
            for count in counts:
                found |= _measure("training", page, count, channels, seconds)
    finally:
        training.close()
    return found


def _measure(name: str, page: PageProcess, count: int, channels: list[str], seconds: float) -> dict[str, float]:
    """Return the share of a core that a page takes with so many browsers, and the kilobytes a second to each."""
    browsers = None
    if count:
        orders = [page.address, str(count), str(seconds + 1.0), json.dumps(channels)]
        browsers = subprocess.Popen(
            python_module("benchmarks.page", *orders), stdout=subprocess.PIPE, text=True, env=child_environment()
        )
        assert browsers.stdout is not None
        browsers.stdout.readline()
    before, began = _cpu(page.pid), time.monotonic()
    time.sleep(seconds)
    found = {f"{name}, {count} browsers: % of a core": 100.0 * (_cpu(page.pid) - before) / (time.monotonic() - began)}
    if browsers is not None:
        told, _ = browsers.communicate(timeout=60)
        found[f"{name}, {count} browsers: kB/s to each"] = float(told) / count / 1e3
    return found


def _cpu(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _browse(address: str, count: int, seconds: float, channels: list[str]) -> None:
    """Be so many browsers, and print how many bytes a second they got once all have the whole picture."""
    from websockets.asyncio.client import connect

    received = [0] * count

    async def one(number: int, ready: asyncio.Barrier) -> None:
        async with connect(address.replace("http", "ws") + "ws", max_size=1 << 24) as socket:
            await socket.send(json.dumps({"type": "watch", "channels": channels}))
            for _ in range(4):
                await socket.recv()
            await ready.wait()
            async with asyncio.timeout(seconds):
                while True:
                    received[number] += len(await socket.recv())

    barrier = asyncio.Barrier(count + 1)
    tasks = [asyncio.create_task(one(number, barrier)) for number in range(count)]
    await barrier.wait()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    await asyncio.gather(*tasks, return_exceptions=True)
    sys.stdout.write(f"{sum(received) / seconds}\n")


if __name__ == "__main__":
    asyncio.run(_browse(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), json.loads(sys.argv[4])))
