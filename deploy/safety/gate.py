"""The bridge's end of the watchdog process."""

from __future__ import annotations

import logging
import subprocess
import threading
import time
from dataclasses import replace
from typing import Any, Final

from common.errors import ConfigError, HDError
from common.system.closing import Closing
from common.system.logs import lasting
from common.system.runtime import python_module
from common.system.threads import Complaints
from deploy.config import DeployConfig
from deploy.network_config import RosConfig
from deploy.ros2 import Node
from deploy.safety.channel import Channel
from deploy.safety.gate_state import GateMode, GateState, emergency_reason
from deploy.safety.output import VelocityOutput
from deploy.safety.rules import STOP_ALL

log = logging.getLogger(__name__)

_START_TIMEOUT: Final = 120.0
_CLOSE_TIMEOUT: Final = 2.0
# The watchdog reports five times a second.
_SILENT: Final = 0.6
_HUNG: Final = 3.0
_ANYWHERE: Final = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}


class SafetyError(HDError):
    """The watchdog cannot do its work."""


def behind_watchdog(ros: RosConfig) -> RosConfig:
    """Return the settings for the bridge's own node: where the bridge is to listen, its watchdog does.

    The robot's connection must outlive the bridge, so the watchdog holds it, and the bridge connects to the watchdog.
    """
    if not ros.listen:
        return ros
    endpoints = []
    for endpoint in ros.listen:
        for anywhere, here in _ANYWHERE.items():
            endpoint = endpoint.replace(f"/{anywhere}:", f"/{here}:")  # noqa: PLW2901
        endpoints.append(endpoint)
    return ros.model_copy(update={"listen": (), "connect": (*endpoints, *ros.connect)})


class WatchdogProcess(Closing):
    """The process of a watchdog, which imports for a second, and does nothing before it is told to begin.

    It ends when this process does.

    Attributes:
        channel: to it.
        process: itself.
    """

    def __init__(self) -> None:
        """Start it."""
        self.channel, theirs = Channel.pair()
        with theirs:
            # A session of its own: what a terminal or a shell sends to the bridge's group does not reach it.
            self.process = subprocess.Popen(
                python_module("deploy.safety.watchdog", str(theirs.fileno())),
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    def begin(self, config: DeployConfig, emergency_stop: str) -> None:
        """Let it watch over the robot of a configuration, with the stop latched for a reason, or not."""
        level = logging.getLevelName(logging.getLogger().getEffectiveLevel()).lower()
        self.channel.send(
            config=config.model_dump_json(),
            emergency_stop=emergency_stop,
            log_level=level if level in {"debug", "info", "warning", "error"} else "info",
        )

    def close(self) -> None:
        """Kill it. Safe to call twice."""
        self.process.kill()
        self.process.wait()
        self.channel.close()


class VelocityGate(Closing):
    """Start the watchdog process, tell it what the bridge commands, and hear what it does.

    The watchdog owns the velocity topic (and `/stop`); the bridge itself never publishes there. No call but the
    constructor and `close` blocks. A thread tells the watchdog four times per `safety.bridge_timeout` that the bridge
    lives, and starts another watchdog should this one die.

    Usage::

        with VelocityGate(config) as gate, Node(behind_watchdog(config.ros)) as node:
            gate.command(0.5, 0.1)  # at driving.rate
            if not gate.state.clear:
                log.info("the robot is stopped: %s", gate.state.reason)
    """

    def __init__(self, config: DeployConfig, process: WatchdogProcess | None = None) -> None:
        """Start the watchdog and wait until it is at work.

        Args:
            config: whole tree.
            process: one that was started before; whoever gives it closes it.

        Raises:
            ConfigError: the configuration leaves it no topic to stop the robot with.
            SafetyError: it does not start; the message says why.
        """
        topics = config.topics
        if not (topics.velocity or topics.stop):
            raise ConfigError("topics.velocity and topics.stop are both empty: name one, to stop the robot with")
        if config.driving.enabled and not topics.velocity:
            raise ConfigError("driving.enabled needs topics.velocity: name the topic of the robot's velocity")
        self._config = config
        self._lock = threading.Lock()
        self._state = GateState(GateMode.HELD, "the watchdog has not started", alive=False)
        self._heard = time.monotonic()
        self._closed = threading.Event()
        self._fallback: VelocityOutput | None = None
        self._cannot_stop = Complaints("stopping the robot without a watchdog")
        self._last_hold: str | None = None
        self._latched = ""
        self._start(process or WatchdogProcess(), "")
        try:
            self._wait_for_start()
        except BaseException:
            self._watchdog.close()
            raise
        self._thread = threading.Thread(target=self._keep, name="velocity-gate", daemon=True)
        self._thread.start()

    def use_when_watchdog_dies(self, node: Node) -> None:
        """Let the bridge's node stop the robot while the watchdog hangs, and until a new one has started."""
        self._fallback = VelocityOutput(
            node, self._config.topics, self._config.driving.message, self._config.frames.base
        )

    def command(self, linear: float, angular: float) -> None:
        """Ask for a velocity (m/s, rad/s); it ends a hold, and is forgotten after `safety.bridge_timeout`."""
        self._last_hold = None
        self._send("command", linear=float(linear), angular=float(angular))

    def hold(self, reason: str) -> None:
        """Ask for zero velocity until the next `command` or `resume`."""
        self._last_hold = reason
        self._send("hold", reason=reason)

    def resume(self) -> None:
        """End a hold without a command, when the robot's own stack drives."""
        self._last_hold = None
        self._send("resume")

    def emergency_stop(self, reason: str) -> None:
        """Latch the emergency stop, as a message on its topic does."""
        # Kept here too: a watchdog that is just being replaced hears nothing.
        self._latched = reason or "by command"
        self._send("emergency_stop", reason=reason)

    def release(self) -> None:
        """Release the emergency stop; it latches again if its topic says so again."""
        self._latched = ""
        self._send("release")

    @property
    def latched(self) -> bool:
        """Whether the emergency stop is latched: by this end, or as the watchdog said last."""
        return self.state.emergency_stop

    @property
    def state(self) -> GateState:
        """What the watchdog said last; `alive` is false while it is dead or silent.

        A stop that was latched here counts at once: the watchdog needs a moment to say so.
        """
        with self._lock:
            state, age = self._state, time.monotonic() - self._heard
        latched = self._latched
        if latched and not state.emergency_stop:
            state = replace(state, mode=GateMode.EMERGENCY_STOP, reason=emergency_reason(latched), emergency_stop=True)
        if state.alive and age > _SILENT:
            return replace(state, alive=False, reason="the watchdog does not answer")
        return state

    @property
    def pid(self) -> int:
        """Process number of the watchdog."""
        return self._watchdog.process.pid

    def close(self) -> None:
        """End the watchdog in order: it sends zeros a little longer and ends."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._thread.join(_CLOSE_TIMEOUT)
        self._send("finish")
        try:
            self._watchdog.process.wait(_CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            log.warning("the watchdog does not end: it is killed")
        self._watchdog.close()

    def _start(self, watchdog: WatchdogProcess, emergency_stop: str) -> None:
        self._watchdog, self._channel = watchdog, watchdog.channel
        watchdog.begin(self._config, emergency_stop)

    def _wait_for_start(self) -> None:
        deadline = time.monotonic() + _START_TIMEOUT
        while not self._state.alive:
            if time.monotonic() > deadline:
                raise SafetyError(
                    f"the watchdog process did not start within {_START_TIMEOUT:g} s: check its log lines and that "
                    f"the robot's router is running ({', '.join(self._config.ros.connect)})"
                )
            self._send("beat")
            self._channel.wait(0.05)
            try:
                self._hear()
            except EOFError:
                raise SafetyError("the watchdog process ended as it started: see its log lines") from None

    def _hear(self) -> None:
        for packet in self._channel.receive():
            if "failed" in packet:
                raise SafetyError(f"the watchdog cannot start: {packet['failed']}")
            with self._lock:
                self._state = GateState(**packet | {"mode": GateMode(packet["mode"])})
                self._heard = time.monotonic()

    def _send(self, kind: str, **fields: Any) -> None:
        self._channel.send(kind=kind, sent=time.monotonic(), **fields)

    def _keep(self) -> None:
        """Beat, hear reports, and replace a watchdog that died or hangs."""
        period = self._config.safety.bridge_timeout / 4.0
        next_beat = 0.0
        while not self._closed.is_set():
            now = time.monotonic()
            if now >= next_beat:
                self._send("beat")
                next_beat = now + period
            try:
                self._channel.wait(max(0.0, next_beat - time.monotonic()))
                self._hear()
                silence = time.monotonic() - self._heard
                if silence > _SILENT:
                    self._stop_the_robot()
                if silence > _HUNG:
                    raise EOFError("it does not answer")
            except (EOFError, SafetyError) as error:
                try:
                    self._replace_watchdog(str(error))
                except OSError as failure:
                    lacking = lasting(self._lacks_watchdog)
                    log.error("no other watchdog can be started (%s): trying again", failure, extra=lacking)
                    self._closed.wait(1.0)

    def _replace_watchdog(self, why: str) -> None:
        log.error("the watchdog is dead or hangs (%s): starting another", why, extra=lasting(self._lacks_watchdog))
        with self._lock:
            latched = self._latched
            if not latched and self._state.emergency_stop:
                latched = "latched before the watchdog was replaced"
            self._state = replace(self._state, alive=False, reason="the watchdog died; another one starts")
        self._watchdog.close()
        self._start(WatchdogProcess(), latched)
        self._heard = time.monotonic()
        if self._last_hold is not None:
            self.hold(self._last_hold)
        while not self._closed.is_set() and not self._state.alive:
            self._stop_the_robot()
            self._send("beat")
            self._channel.wait(0.05)
            try:
                self._hear()
            except (EOFError, SafetyError) as error:
                lacking = lasting(self._lacks_watchdog)
                log.error("the new watchdog ended as it started (%s): trying again", error, extra=lacking)
                self._closed.wait(1.0)
                return

    def _lacks_watchdog(self) -> bool:
        return not self._state.alive

    def _stop_the_robot(self) -> None:
        """Do the watchdog's work for as long as it cannot."""
        if self._fallback is not None:
            # Whether it can publish or not, another watchdog must be started.
            with self._cannot_stop:
                self._fallback.velocity(0.0, 0.0)
            with self._cannot_stop:
                self._fallback.stop(STOP_ALL)
