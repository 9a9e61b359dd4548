"""The soak's robot, bridge and onlooker: goals that keep the robot driving, and what everybody says meanwhile."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import psutil

from benchmarks.link import Link
from benchmarks.soak_robot import SoakRobot
from common.bus.control import request
from common.errors import HDError
from common.system.closing import Closing
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import end_process, free_endpoint, start_process
from deploy.robot.options import RobotOptions
from deploy.ros2 import Node, Publisher, message

log = logging.getLogger(__name__)

PLANNER: Final = "dstar_lite"
# A fresh checkout compiles its kernels first.
START_SECONDS: Final = 600.0
_FAST: Final = 0.4
_STEADY: Final = 0.7


class SoakError(HDError):
    """The soak cannot continue."""


class Rig(Closing):
    """A simulated robot in this process, and a real bridge behind a link that can be cut.

    Usage::

        with Rig(RobotOptions(), Path("runs/soak")) as rig:
            rig.roll(60.0)
            rig.heard.clear()

    Attributes:
        robot: the simulated one.
        link: between the robot's network and bridge and watchdog.
        bridge: its process.
        heard: kinds of faults, states of the watchdog, and warnings that were told since it was cleared.
        memory: samples (time, bytes) by process number of the bridges, from their first status on.
    """

    def __init__(self, options: RobotOptions, folder: Path) -> None:
        """Start the robot and the bridge."""
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        endpoint = free_endpoint()
        self.settings = [f"decision.planner={PLANNER}", "decision.task=navigation"]
        self.config = load_deploy_config(overrides=self.settings)
        ros = self.config.ros.model_copy(update={"listen": (endpoint,), "connect": (), "node": "hd_robot"})
        self._guest = ros.model_copy(update={"listen": (), "connect": (endpoint,)})
        self.heard: set[str] = set()
        self.memory: dict[int, list[tuple[float, int]]] = {}
        self._status: dict[str, Any] = {}
        self._target = -1
        self._asked = 0.0
        self._node = Node(ros)
        topics = self.config.topics
        self._node.subscribe(topics.status, "std_msgs/msg/String", lambda sent, _: self._take_status(sent.data))
        self._node.subscribe(topics.watchdog, "std_msgs/msg/String", lambda sent, _: self._take_gate(sent.data))
        kinds = {"command": "String", "emergency_stop": "Bool"}
        self._publishers: dict[str, Publisher] = {
            name: self._node.publisher(getattr(topics, name), f"std_msgs/msg/{kind}") for name, kind in kinds.items()
        }
        velocity = f"geometry_msgs/msg/{self.config.driving.message}"
        self._velocity = self._node.latest(topics.velocity, velocity)
        self._publishers["joy"] = self._node.publisher(topics.joy, "sensor_msgs/msg/Joy")
        self.robot = SoakRobot(options, self.config, self._node)
        self.link = Link(endpoint)
        self.bridge = self._spawn("bridge", "w")

    @property
    def status(self) -> dict[str, Any]:
        """What the bridge said last; empty before the first."""
        return self._status

    @property
    def silent_for(self) -> float:
        """Seconds since the last velocity came."""
        return self._velocity.age()

    def start_bridge(self) -> None:
        """Start a bridge in the place of one that was killed."""
        self.bridge.wait()
        self._status = {}
        self.bridge = self._spawn("bridge", "a")

    def try_second_bridge(self) -> None:
        """Start another bridge of the same name, and hear that it refuses."""
        second = self._spawn("second", "w")
        try:
            code = second.wait(60.0)
        except subprocess.TimeoutExpired:
            second.kill()
            second.wait()
            return
        if code and "name" in (self._folder / "second.log").read_text("utf-8", errors="replace"):
            self.heard.add("refused")

    def watchdog_pid(self) -> int:
        """Return the process number of the watchdog at work."""
        for child in psutil.Process(self.bridge.pid).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                if any("watchdog" in part for part in child.cmdline()) and child.status() != psutil.STATUS_ZOMBIE:
                    return child.pid
        raise SoakError("there is no watchdog")

    @staticmethod
    def send_signal(pid: int, number: signal.Signals) -> None:
        """Signal a process, which may be gone."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)

    def publish(self, name: str, sent: Any) -> None:
        """Publish on the topic of this name: command, emergency_stop or joy."""
        self._publishers[name].publish(sent)

    def release(self) -> None:
        """Release the emergency stop, as an operator does."""
        why = {"who": "soak", "why": "the fault is over"}
        request(self._node.session, self.config.name, "release", 10.0, why, asked="robot")

    @contextmanager
    def intruder(self) -> Iterator[Publisher]:
        """Let another node publish velocities for the time of a `with`."""
        with Node(self._guest, "soak_intruder") as node:
            yield node.publisher(self.config.topics.velocity, f"geometry_msgs/msg/{self.config.driving.message}")

    def roll(self, seconds: float) -> bool:
        """Wait until the robot drives fast and nothing is wrong, with goals as it needs them; False if it does not."""

        def rolls() -> bool:
            lately = self.robot.since(time.monotonic() - _STEADY)
            fast = bool(lately) and all(motion.speed > _FAST for motion in lately)
            return fast and not self.status.get("faults", {"": ""}) and self.status.get("gate") == "clear"

        return self.until(rolls, seconds)

    def until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Wait for something while the robot is kept busy; say whether it came.

        Raises:
            SoakError: the simulation has ended.
        """
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.tend()
            time.sleep(0.02)
        return True

    def tend(self) -> None:
        """Give the robot its next goal when it needs one, and look at the memory."""
        if not self.robot.lives:
            raise SoakError("the simulation has ended: see the error above")
        now = time.monotonic()
        if now - self._asked < 1.0:
            return
        self._asked = now
        if self._status:
            # From its first word on: until then it compiles and loads.
            with contextlib.suppress(psutil.Error):
                size = psutil.Process(self.bridge.pid).memory_info().rss
                self.memory.setdefault(self.bridge.pid, []).append((now, size))
        state = self.status.get("state")
        if state in {"idle", "finished", "failed", "aborted"} and not self.status.get("emergency_stop"):
            self._target = (self._target + 1) % len(self.robot.places)
            x, y = self.robot.places[self._target]
            self.publish("command", message("std_msgs/msg/String", data=f"goal {x:.2f} {y:.2f}"))
            self.publish("command", message("std_msgs/msg/String", data="start"))

    def close(self) -> None:
        """End the bridge, then the robot; safe to call twice."""
        self.link.mend()
        end_process(self.bridge)
        self.robot.close()
        self.link.close()
        self._node.close()

    def _spawn(self, name: str, mode: str) -> subprocess.Popen[bytes]:
        options = [part for setting in self.settings for part in ("--set", setting)]
        # Peers would find the robot beside the link; a client has nothing but what it connects to.
        arguments = ["bridge", *options, "--set", "ros.mode=client", "--connect", self.link.endpoint]
        return start_process(arguments, self._folder / f"{name}.log", mode)

    def _take_status(self, text: str) -> None:
        self._status = status = json.loads(text)
        self.heard |= set(status["faults"])
        if status["gate"] != "clear":
            self.heard.add(status["gate"])
        error = status["error"]
        if error is not None and error["age"] < 2.0:
            self.heard.add(error["text"])

    def _take_gate(self, text: str) -> None:
        mode = json.loads(text)["mode"]
        if mode != "clear":
            self.heard.add(mode)
