"""A simulated robot and a bridge as processes on a bus of their own, watched from outside."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from common.errors import HDError
from common.planners.base import Position
from common.system.closing import Closing
from common.system.runtime import process_environment, python_module
from deploy.config import DeployConfig
from deploy.robot.interface import TRUTH_TOPIC
from deploy.robot.simulation import Grid
from deploy.ros2 import LATCHED, Latest, Node
from deploy.ros2.conversions import grid_from, path_from, position_from

STOP_SECONDS = 10.0
_LOG_TAIL = 15


class DeploymentError(HDError):
    """The robot or the bridge ended, or does not come up."""


class Deployment(Closing):
    """Starts both, listens to what they tell, and ends both.

    Usage::

        with Deployment(config, ["--map", "hall.png"], ["--planner", "greedy", "--autostart"], folder) as deployment:
            while deployment.status()["state"] != "finished":
                deployment.check()

    Attributes:
        endpoint: of the robot, which is the router of the bus.
        config: of whoever joins that bus.
        robot: process of the robot.
        bridge: process of the bridge.
    """

    def __init__(
        self,
        config: DeployConfig,
        common: Sequence[str],
        robot: Sequence[str],
        bridge: Sequence[str],
        folder: Path,
    ) -> None:
        """Start the robot and the bridge, and join their bus.

        Args:
            config: what the options in ``common`` resolve to.
            common: options of both commands, such as ``--profile cmu``.
            robot: more options of `hd-deploy robot`.
            bridge: more options of `hd-deploy bridge`.
            folder: where their logs go.
        """
        self.endpoint = free_endpoint()
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.robot = self._start("robot", [*common, *robot, "--listen", self.endpoint])
        self.bridge = self._start("bridge", [*common, *bridge, "--connect", self.endpoint])
        try:
            ros = config.ros.model_copy(update={"listen": (), "connect": (self.endpoint,)})
            self.config = config.model_copy(update={"ros": ros})
            self.node = Node(ros, "hd_watcher", config.topics.remap)
        except BaseException:
            self._end()
            raise
        topics = config.topics
        self._truth = self.node.latest(TRUTH_TOPIC, "std_msgs/msg/String")
        self._status = self.node.latest(topics.status, "std_msgs/msg/String")
        self._belief = self.node.latest(topics.belief, "nav_msgs/msg/OccupancyGrid", LATCHED)
        self._path = self.node.latest(topics.path, "nav_msgs/msg/Path")
        self._beacon = self.node.latest(topics.beacon, "geometry_msgs/msg/PointStamped")

    def truth(self) -> dict[str, Any] | None:
        """Return what the simulation told last: pose, distance, collisions; None before the first."""
        return _json(self._truth)

    def truth_age(self) -> float:
        """Seconds since the simulation told something."""
        return self._truth.age()

    def status(self) -> dict[str, Any] | None:
        """Return the bridge's last status; None before the first."""
        return _json(self._status)

    def belief(self) -> Grid | None:
        """Return what the bridge knows; None before the first."""
        found = self._belief.get()
        if found is None:
            return None
        cells, resolution, (x, y, _) = grid_from(found[0])
        return Grid(cells, resolution, (x, y))

    def path(self) -> list[Position]:
        """Return the waypoint and the route beyond it, metres in the map frame."""
        found = self._path.get()
        return [] if found is None else path_from(found[0])

    def beacon(self) -> Position | None:
        """Return the chosen beacon, metres in the map frame."""
        found = self._beacon.get()
        return None if found is None else position_from(found[0])[1]

    def check(self) -> None:
        """Raise `DeploymentError` when a process has ended, with the last lines of its log."""
        for name, process in (("robot", self.robot), ("bridge", self.bridge)):
            if process.poll() is not None:
                raise DeploymentError(f"the {name} ended with code {process.returncode}:\n{self.log_tail(name)}")

    def until(self, condition: Callable[[], Any], seconds: float, what: str) -> Any:
        """Wait until a condition is true and return its value.

        Raises:
            DeploymentError: it is not in time, or a process has ended.
        """
        end = time.monotonic() + seconds
        while True:
            value = condition()
            if value:
                return value
            self.check()
            if time.monotonic() > end:
                tails = "\n".join(f"--- {name}\n{self.log_tail(name)}" for name in ("robot", "bridge"))
                raise DeploymentError(f"{what}: not within {seconds:.0f} s; status {self.status()}\n{tails}")
            time.sleep(0.02)

    def log_tail(self, name: str, lines: int = _LOG_TAIL) -> str:
        """Return the last lines that a process wrote."""
        return "\n".join(self._log(name).read_text("utf-8", errors="replace").splitlines()[-lines:])

    def close(self) -> None:
        """End both processes in good order, by force where that takes too long; safe to call twice."""
        self.node.close()
        self._end()

    def _end(self) -> None:
        # The bridge first: it stops the robot, which is still there to be stopped.
        for process in (self.bridge, self.robot):
            end_process(process)

    def _start(self, name: str, options: Sequence[str]) -> subprocess.Popen[bytes]:
        return start_process([name, *options], self._log(name))

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"


def start_process(arguments: Sequence[str], log: Path, mode: str = "w") -> subprocess.Popen[bytes]:
    """Start `hd-deploy` with these arguments as a process that ends with this one.

    Args:
        arguments: command and options.
        log: file that takes what it prints.
        mode: ``w`` begins the file, ``a`` appends to it.
    """
    command = python_module("deploy", *arguments)
    with log.open(mode, encoding="utf-8") as out:
        return subprocess.Popen(
            python_module("common.system.tethered", str(os.getpid()), *command),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            env=process_environment(threads=1),
        )


def end_process(process: subprocess.Popen[bytes]) -> None:
    """End a process in good order, or by force where that takes more than `STOP_SECONDS`; safe to call twice."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(STOP_SECONDS)
    if process.poll() is None:
        process.kill()
        process.wait()


def free_endpoint() -> str:
    """Return a loopback endpoint that nobody listens at."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{found.getsockname()[1]}"


def _json(latest: Latest) -> dict[str, Any] | None:
    found = latest.get()
    return None if found is None else json.loads(found[0].data)
