"""A recording as the source of a page: it is shown as the robot was, with a place in time to go to."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

from common.page.hub import Hub
from common.page.source import Command, Source
from deploy.bridge.command_text import CommandError
from deploy.config import DeployConfig
from deploy.page.feed import RobotFeed, roles_of
from deploy.recording.errors import RecordingError
from deploy.recording.order import FileOrder
from deploy.recording.reader import read_bag
from deploy.recording.steady import without_clock_steps

log = logging.getLogger(__name__)

_SPEEDS: Final = (0.1, 100.0)
_IDLE: Final = 0.05


@dataclass(frozen=True, slots=True)
class Place:
    """Where a replay is.

    Attributes:
        position: seconds from the beginning of the recording.
        playing: time passes.
        speed: times faster than it was.
        jumps: how often it was sent elsewhere.
    """

    position: float = 0.0
    playing: bool = True
    speed: float = 1.0
    jumps: int = 0


class Replay(Source):
    """Plays a recording through the channels of a live robot; its commands are those of a player."""

    verbs = ("play", "pause", "seek", "speed")

    def __init__(self, path: Path, config: DeployConfig) -> None:
        """Find out how long the recording is and which of its topics the page reads, and begin to play it.

        Args:
            path: folder of a bag, or one of its files.
            config: of the robot that was recorded.

        Raises:
            RecordingError: there is no recording, or it holds no status of a bridge.
        """
        self._path = path
        self._roles = {topic: role for role, (topic, _, _) in roles_of(config).items()}
        self._order = FileOrder()
        for _ in self._order.learning(read_bag(path)):
            pass
        times, found = [], set()
        for recorded in without_clock_steps(self._order.read(path, self._roles)):
            if recorded.topic in self._roles:
                times.append(recorded.time)
                found.add(self._roles[recorded.topic])
        if "status" not in found:
            wanted = next(topic for topic, role in self._roles.items() if role == "status")
            raise RecordingError(
                f"{path} holds no message of {wanted}: record a robot whose bridge runs, or give its --profile"
            )
        self._begin, self._length = min(times), (max(times) - min(times)) * 1e-9
        self._place = Place()
        self._lock = threading.Lock()
        self._now = self._begin * 1e-9
        self._feed = RobotFeed(config, clock=lambda: self._now)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._play, name="replay", daemon=True)
        self._thread.start()

    def refresh(self, hub: Hub) -> None:
        """Put what the recording holds up to this moment."""
        self._feed.refresh(hub)
        with self._lock:
            place = self._place
        if self._feed.name:
            hub.put("robots", [{"name": self._feed.name, "silent": False}])
        hub.put(
            "replay",
            {
                "recording": self._path.name,
                "began": round(self._begin * 1e-9, 2),
                "position": round(place.position, 1),
                "length": round(self._length, 1),
                "playing": place.playing,
                "speed": place.speed,
            },
        )

    def carry_out(self, command: Command) -> Mapping[str, Any]:
        """Play, pause, go to ``position`` (seconds), or play ``factor`` times as fast.

        Raises:
            CommandError: an argument is no number.
        """
        with self._lock:
            place = self._place
            if command.verb == "seek":
                position = min(max(_number(command, "position"), 0.0), self._length)
                self._place = replace(place, position=position, jumps=place.jumps + 1)
            elif command.verb == "speed":
                self._place = replace(place, speed=min(max(_number(command, "factor"), _SPEEDS[0]), _SPEEDS[1]))
            elif command.verb == "play" and place.position >= self._length:
                self._place = replace(place, playing=True, position=0.0, jumps=place.jumps + 1)
            else:
                self._place = replace(place, playing=command.verb == "play")
            return {"position": self._place.position, "playing": self._place.playing, "speed": self._place.speed}

    def close(self) -> None:
        """Stop playing; safe to call twice."""
        self._closed.set()
        self._thread.join()

    def _play(self) -> None:
        """Play from the beginning again and again, as often as the place is moved."""
        while not self._closed.is_set():
            with self._lock:
                jump = self._place.jumps
            self._feed.forget()
            self._play_from_begin(jump)
            # At the end: wait to be sent elsewhere.
            while not self._closed.wait(_IDLE) and not self._moved(jump):
                pass

    def _play_from_begin(self, jump: int) -> None:
        before = time.monotonic()
        steady = without_clock_steps(self._order.read(self._path, self._roles), say=False)
        messages = (each for each in steady if each.topic in self._roles)
        for recorded in chain(messages, [None]):
            at = self._length if recorded is None else (recorded.time - self._begin) * 1e-9
            while not self._closed.is_set():
                now = time.monotonic()
                passed, before = now - before, now
                with self._lock:
                    place = self._place
                    if place.jumps != jump:
                        return
                    if place.playing:
                        # Up to the place all messages come at once; from there on in their time.
                        position = min(place.position + passed * place.speed, self._length)
                        self._place = place = replace(place, position=position)
                if at <= place.position:
                    break
                self._closed.wait(min(max((at - place.position) / place.speed, 0.0), _IDLE))
            if self._closed.is_set():
                return
            self._now = self._begin * 1e-9 + at
            if recorded is not None:
                self._feed.take(self._roles[recorded.topic], recorded.payload)
        with self._lock:
            self._place = replace(self._place, playing=False)

    def _moved(self, jump: int) -> bool:
        with self._lock:
            return self._place.jumps != jump


def _number(command: Command, name: str) -> float:
    value = command.arguments.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise CommandError(f"{command.verb} needs the number {name!r}, got {str(value)[:40]!r}")
    return float(value)
