"""What pages are measured with: a robot that speaks as a bridge does, and a run that answers as a learner does."""

from __future__ import annotations

import json
import threading
import time
from contextlib import ExitStack
from typing import Any, Final

import numpy as np

from common.bus.control import ControlServer
from common.bus.session import open_client_session, open_learner_session
from common.bus.views import ViewPublisher
from common.config import BusConfig, RunConfig
from common.geometry import Pose, Scan
from common.messages.replies import ControlRequest
from common.messages.view import EpisodeView
from deploy.config import DeployConfig
from deploy.robot.deployment import free_endpoint
from deploy.ros2 import LATCHED, RELIABLE, SENSOR, Node, QoS, message
from deploy.ros2.conversions import laser_scan, occupancy_grid, odometry, path
from learner.watch.status import ActorStatus, EpisodeMeans, LearnerStatus

TICK: Final = 0.05
_SHAPE: Final = (500, 650)
_VIEW_SECONDS: Final = 0.25


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
            due = max(due + TICK, time.monotonic())
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


class Run:
    """A run of so many actors: its status changes with every answer, and one actor shows its episode 4 times a second.

    Attributes:
        config: of the run.
        watched: name of the actor that shows itself.
    """

    def __init__(self, actors: int) -> None:
        bus = BusConfig(listen=free_endpoint())
        self.config = RunConfig(bus=bus)
        self.watched = "desk-0"
        self._actors = actors
        self._parts = ExitStack()
        self._stop = threading.Event()
        session = self._parts.enter_context(open_learner_session(bus))
        self._parts.enter_context(ControlServer(session, self.config.name, self._answer))
        acting = self._parts.enter_context(open_client_session(bus))
        self._views = self._parts.enter_context(ViewPublisher(acting, self.config.name, "actor", self.watched))
        self._thread = threading.Thread(target=self._act, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the run."""
        self._stop.set()
        self._thread.join()
        self._parts.close()

    def _answer(self, request: ControlRequest) -> dict[str, Any]:
        updates = int(10.0 * time.monotonic())
        actors = [
            ActorStatus(
                name=f"desk-{i}", role="actor", alive=True, host="desk", steps_per_second=61.2 + updates % 7,
                steps=10 * updates, episodes=321, version=40, lag=2, lag_seconds=7.0, buffered=1, silent=0.3,
                state="acting", restarts=0, last_error="",
            )
            for i in range(self._actors)
        ]  # fmt: skip
        status = LearnerStatus(
            run=self.config.name, folder="runs/office", endpoint="tcp/127.0.0.1:7447", state="training", device="cpu",
            uptime=100.0, steps=160 * updates, episodes=987, updates=updates, total_updates=10 * updates,
            steps_per_second=122.5, updates_per_second=10.0, version=42, replay=54_000, replay_capacity=100_000,
            replay_fill=0.54, replay_bytes=130_000_000, ratio_declared=0.0625, ratio_actual=0.0624, ratio_lead=17.0,
            hold=0.0, next_checkpoint=123.0, last_checkpoint="000003200", best=37,
            best_figures={"distance": 248.5, "success": 1.0}, evaluated=41,
            evaluated_figures={"distance": 250.25, "success": 1.0}, refused=0,
            losses={"loss/critic": 0.512, "loss/policy": -1.25 + 0.01 * (updates % 9)},
            late={"train": EpisodeMeans(100, 251.3, 0.97, 0.992, 3.5, 41.2, 0.0)}, actors=actors,
        )  # fmt: skip
        return status.page(str(request.arguments.get("after", "")))

    def _act(self) -> None:
        random = np.random.default_rng(0)
        cells = np.full((200, 260), -1, np.int8)

        def places(count: int) -> np.ndarray[Any, np.dtype[np.float32]]:
            return random.uniform(0.0, 100.0, (count, 2)).astype(np.float32)

        viewpoints, kinds = places(300), random.integers(0, 3, 300).astype(np.uint8)
        edges = random.integers(0, 300, (2000, 2)).astype(np.uint16)
        step = 0
        while not self._stop.wait(_VIEW_SECONDS):
            if not self._views.looked_at:
                continue
            step += 1
            column = 4 * step % 220
            cells[40:160, column : column + 40] = random.choice([0, 0, 0, 100], (120, 40))
            self._views.send(
                EpisodeView(
                    actor=self.watched, family="worlds", world="office-1", task="exploration", driver="policy",
                    version=42, step=step, distance=4.0 * step, explored=0.5, ended=False, success=False,
                    resolution=0.5, origin=(0.0, 0.0), cells=cells, viewpoints=viewpoints, kinds=kinds, edges=edges,
                    frontiers=places(300), beacons=places(12), way=places(100), beacon=places(1), waypoint=places(1),
                    target=places(0),
                )
            )  # fmt: skip
