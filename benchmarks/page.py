"""What the page costs: its process at 0, 1 and 10 browsers, bytes to each, and how late a control loop beside it comes.

A robot's node speaks on the topics as a bridge and its robot do (status 2 Hz, belief, scene and path 1 Hz, odometry
20 Hz, scan 10 Hz, a building of 130 m x 100 m that is explored as it goes) and keeps a loop of 20 Hz. Its page runs as
a process of its own, the browsers are WebSocket clients in a third process. The loop without a page and with one of ten
browsers is measured in turns, within one run.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Final

import numpy as np

from common.geometry import Pose, Scan
from common.page.options import PageSettings
from common.page.process import PageProcess
from common.system.runtime import python_module
from deploy.config import DeployConfig
from deploy.page.process import start_page
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import free_endpoint
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, Node, QoS, message
from deploy.ros2.conversions import laser_scan, occupancy_grid, odometry, path

SECONDS: Final = float(os.environ.get("HD_BENCH_SECONDS", "12"))
_TICK: Final = 0.05
_SHAPE: Final = (500, 650)


class Speaker:
    """Says what a bridge and its robot say, from one loop of 20 Hz, and notes how late each round of it comes."""

    def __init__(self, config: DeployConfig) -> None:
        self.late: list[float] = []
        self._stop = threading.Event()
        self._node = Node(config.ros, "hd_bridge")
        kinds = {
            "/hd/status": ("std_msgs/msg/String", RELIABLE),
            "/hd/scene": ("std_msgs/msg/String", QoS(depth=1)),
            "/hd/belief": ("nav_msgs/msg/OccupancyGrid", LATCHED),
            "/hd/path": ("nav_msgs/msg/Path", RELIABLE),
            "/odom": ("nav_msgs/msg/Odometry", SENSOR),
            "/scan": ("sensor_msgs/msg/LaserScan", SENSOR),
            "/runtime": ("std_msgs/msg/Float32", RELIABLE),
        }
        self._say = {topic: self._node.publisher(topic, kind, qos).publish for topic, (kind, qos) in kinds.items()}
        self._cells = np.full(_SHAPE, -1, np.int8)
        self._random = np.random.default_rng(0)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Say no more."""
        self._stop.set()
        self._thread.join()
        self._node.close()

    def _run(self) -> None:
        due, tick = time.monotonic(), 0
        while not self._stop.wait(max(due - time.monotonic(), 0.0)):
            self.late.append(time.monotonic() - due)
            due = max(due + _TICK, time.monotonic())
            self._round(tick)
            tick += 1

    def _round(self, tick: int) -> None:
        now, x = time.time(), 0.05 * (tick % 2000)
        pose = Pose(x, 40.0, 0.0)
        self._say["/odom"](odometry(now, "map", "base_link", pose, (1.0, 0.0)))
        if tick % 2 == 0:
            ranges = self._random.uniform(2.0, 9.0, 720).astype(np.float32)
            self._say["/scan"](laser_scan(now, "base_link", Scan(ranges, -np.pi, 2.0 * np.pi / 720, 20.0, 0.1)))
        if tick % 10 == 0:
            told = {"distance": 1.25, "duration": 1.25, "decision_p95": 0.01, "explored_area": 41.5}
            told |= {"name": "robot", "state": "running", "reason": "on the way", "now": now, "faults": {}}
            self._say["/hd/status"](message("std_msgs/msg/String", data=json.dumps(told)))
        if tick % 20 == 0:
            column = int(x / 0.2)
            self._cells[150:250, column : column + 40] = self._random.choice([0, 0, 0, 100], (100, 40))
            self._say["/hd/belief"](occupancy_grid(now, "map", self._cells, 0.2, (0.0, 0.0)))
            scene = {"version": 1, "cell": 20, "viewpoints": [100, 200, 2] * 500, "edges": [100, 200, 300, 400] * 2000}
            scene |= {"frontiers": [tick, 200] * 1500, "beacons": [100, 200, 300] * 20, "banned": []}
            self._say["/hd/scene"](message("std_msgs/msg/String", data=json.dumps(scene)))
            self._say["/hd/path"](path(now, "map", [(x, 40.0), (x + 5.0, 41.0)]))
            self._say["/runtime"](message("std_msgs/msg/Float32", data=0.01))


def run() -> dict[str, float]:
    """Measure and return the figures by name."""
    endpoint = free_endpoint()
    config = load_deploy_config(None, ["ros.connect=", f"ros.listen={endpoint}"], profile="bare")
    speaker = Speaker(config)
    found: dict[str, float] = {}
    lateness: dict[str, list[float]] = {"without": [], "with": []}
    try:
        for _ in range(2):
            speaker.late.clear()
            time.sleep(SECONDS / 2.0)
            lateness["without"] += speaker.late
            with start_page(PageSettings(0), config) as page:
                time.sleep(2.0)
                for count in (0, 1, 10):
                    speaker.late.clear()
                    cpu, bytes_each = _measure(page, count)
                    found[f"{count} browsers: page's process, % of a core"] = 100.0 * cpu
                    if count:
                        found[f"{count} browsers: kB/s to each"] = bytes_each / 1e3
                lateness["with"] += speaker.late
    finally:
        speaker.close()
    for name, late in lateness.items():
        quantile = 1e3 * float(np.quantile(np.array(late), 0.99))
        found[f"loop of 20 Hz {name} ten browsers: 99 % no later than, ms"] = quantile
    return found


def _measure(page: PageProcess, count: int) -> tuple[float, float]:
    """Return the share of a core that a page takes with so many browsers, and the bytes per second to each."""
    browsers = None
    if count:
        command = python_module("benchmarks.page", page.address, str(count), str(SECONDS + 1.0))
        browsers = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert browsers.stdout is not None
        browsers.stdout.readline()
    before, began = _cpu(page.pid), time.monotonic()
    time.sleep(SECONDS)
    share = (_cpu(page.pid) - before) / (time.monotonic() - began)
    received = 0.0
    if browsers is not None:
        told, _ = browsers.communicate(timeout=60)
        received = float(told) / count
    return share, received


def _cpu(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def _browse(address: str, count: int, seconds: float) -> None:
    """Be so many browsers, and print how many bytes a second they got once all have the whole picture."""
    from websockets.asyncio.client import connect

    received = [0] * count

    async def one(number: int, ready: asyncio.Barrier) -> None:
        async with connect(address.replace("http", "ws") + "ws", max_size=1 << 24) as socket:
            await socket.send(json.dumps({"type": "watch", "channels": ["*"]}))
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
    asyncio.run(_browse(sys.argv[1], int(sys.argv[2]), float(sys.argv[3])))
