"""The messages of a recording in the order of their times, where the file holds them in another."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Collection, Iterable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Final

from deploy.recording.reader import read_bag
from deploy.recording.steady import BACK
from deploy.recording.storage import Recorded

log = logging.getLogger(__name__)

_TIME: Final = attrgetter("time")
# Threads exchange neighbours again and again. What lies behind so seldom and by more than so many nanoseconds was
# written after the clock had been set back a little.
_SELDOM: Final = 3
_NEIGHBOURS: Final = 100_000_000


class FileOrder:
    """Learns by one pass over a recording how its messages lie, and reads it in the order of their times.

    Recorders that write with several threads exchange neighbours; tools that convert recordings may write one topic
    after the other. A topic that itself goes back by more than `BACK` tells that the clock was set instead: such a
    recording is read as it lies, because its times do not say what came first.

    Usage::

        order = FileOrder()
        for recorded in order.learning(read_bag(path)):
            ...
        for recorded in order.read(path, wanted={"/scan", "/odom"}):
            ...
    """

    def __init__(self) -> None:
        """Know nothing yet."""
        self._newest: dict[str, int] = {}
        self._front = 0
        self._late = 0
        self._times_behind = 0
        self._behind = False
        self._torn = False
        self._clock_set = False

    def learning(self, messages: Iterable[Recorded]) -> Iterator[Recorded]:
        """Yield the messages of a recording, in the order of the file, and learn how they lie."""
        for recorded in messages:
            self._learn(recorded)
            yield recorded

    def read(self, path: Path, wanted: Collection[str]) -> Iterator[Recorded]:
        """Yield the messages in the order of their times.

        Args:
            path: of the recording that was learnt.
            wanted: topics. Where topics lie one after the other, the file is read once for each of these, and
                messages of others are left out; else they come, too.

        Raises:
            RecordingError: there is no recording any more.
        """
        little = self._late > _NEIGHBOURS and self._times_behind <= _SELDOM
        if self._clock_set or not (self._torn or self._late) or (little and not self._torn):
            yield from read_bag(path)
        elif not self._torn:
            yield from self._sorted(read_bag(path))
        else:
            log.warning("%s: messages do not lie in the order of their times, so they are sorted", path)
            there = [topic for topic in wanted if topic in self._newest]
            yield from heapq.merge(*(self._sorted(_of(path, topic)) for topic in there), key=_TIME)

    def _learn(self, recorded: Recorded) -> None:
        topic, time = recorded.topic, recorded.time
        newest = self._newest.get(topic, time)
        self._newest[topic] = max(newest, time)
        self._clock_set = self._clock_set or newest - time > BACK
        behind = self._front - time
        self._torn = self._torn or behind > BACK
        # Within a topic that lies apart from the others, its own messages tell how late one may come.
        self._late = max(self._late, min(behind, newest - time if behind > BACK else behind))
        self._times_behind += behind > 0 and not self._behind
        self._behind = behind > 0
        self._front = max(self._front, time)

    def _sorted(self, messages: Iterable[Recorded]) -> Iterator[Recorded]:
        """Sort messages of which none lies further behind the newest one than was learnt."""
        waiting: list[tuple[int, int, Recorded]] = []
        for number, recorded in enumerate(messages):
            heapq.heappush(waiting, (recorded.time, number, recorded))
            while waiting[0][0] + self._late < recorded.time:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]


def _of(path: Path, topic: str) -> Iterator[Recorded]:
    return (recorded for recorded in read_bag(path) if recorded.topic == topic)
