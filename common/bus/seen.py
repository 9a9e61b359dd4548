"""Which deliveries have been stored: what turns at-least-once delivery into exactly-once storage, for ever."""

from __future__ import annotations

import base64
import hashlib
import secrets
import time
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import CheckpointError

MAX_RANGES = 256
MAX_OPEN_PER_HOST = 4_096
MAX_CLOSED = 1_000_000
STREAM_SECONDS = 3600.0
"""A stream that was silent for this long is kept as one number."""
_MERGE_EVERY = 4_096

Stream = tuple[str, int]
"""(actor, incarnation)."""


def itself(actor: str) -> str:
    """Take every actor for a host of its own."""
    return actor


@dataclass(slots=True)
class _Open:
    """A stream that speaks: ascending, disjoint bounds [first, end, first, end, ...], each end exclusive."""

    bounds: list[int]
    heard: float

    @property
    def whole(self) -> bool:
        """Whether everything from 0 to the end is there."""
        return len(self.bounds) == 2 and self.bounds[0] == 0


class SeenSet:
    """Sequence numbers per (actor, incarnation), held as ranges: one range per stream when nothing is missing.

    A learner that restarts from an older state leaves a gap for what the actors know to be delivered; ranges hold
    such gaps at no cost. Beyond 256 ranges in one stream the two oldest are joined, far outside what an actor with its
    window of at most 32 can reach.

    Nothing is ever forgotten. A stream that was silent for an hour and lacks nothing is kept as one number, its end, 16
    bytes with its name's digest, and opened again when it speaks. Of each host at most 4,096 streams are open: beyond
    that the longest silent one of that host is kept as its end alone, so that invented names harm their own host only.

    Args:
        host_of: tells the host of an actor.
        clock: monotonic seconds.
    """

    def __init__(self, host_of: Callable[[str], str] = itself, clock: Callable[[], float] = time.monotonic) -> None:
        self._host_of = host_of
        self._clock = clock
        self._streams: dict[Stream, _Open] = {}
        self._hosts: dict[str, OrderedDict[Stream, None]] = {}
        self._closed = _Ends()

    def __len__(self) -> int:
        open_streams = sum(sum(held.bounds[1::2]) - sum(held.bounds[::2]) for held in self._streams.values())
        return open_streams + self._closed.total(self._streams)

    def __contains__(self, delivery: tuple[str, int, int]) -> bool:
        actor, incarnation, sequence = delivery
        held = self._streams.get((actor, incarnation))
        if held is None:
            return sequence < self._closed.end((actor, incarnation))
        return bool(bisect_right(held.bounds, sequence) & 1)

    @property
    def full(self) -> bool:
        """Whether no further stream may begin: a million are more than any run has, and somebody invents them."""
        return len(self._closed) + len(self._streams) >= MAX_CLOSED

    def knows(self, actor: str, incarnation: int) -> bool:
        """Whether something of a stream was stored."""
        return (actor, incarnation) in self._streams or self._closed.end((actor, incarnation)) > 0

    def add(self, actor: str, incarnation: int, sequence: int) -> bool:
        """Add a delivery; return False when it was there already."""
        stream = (actor, incarnation)
        if (actor, incarnation, sequence) in self:
            return False
        bounds = self._touch(stream).bounds
        place = bisect_right(bounds, sequence)
        # The new range [sequence, sequence + 1) swallows the bounds that it touches on either side.
        joins_left = place > 0 and bounds[place - 1] == sequence
        joins_right = place < len(bounds) and bounds[place] == sequence + 1
        low, high = place - joins_left, place + joins_right
        bounds[low:high] = ([] if joins_left else [sequence]) + ([] if joins_right else [sequence + 1])
        if len(bounds) > 2 * MAX_RANGES:
            del bounds[1:3]
        return True

    def tidy(self) -> None:
        """Keep the streams that lack nothing and were silent for long as one number each."""
        silent_since = self._clock() - STREAM_SECONDS
        for stream in [key for key, held in self._streams.items() if held.heard < silent_since and held.whole]:
            self._close(stream)

    def streams(self) -> dict[Stream, list[tuple[int, int]]]:
        """Return the ranges [first, end) of each open (actor, incarnation)."""
        return {
            stream: list(zip(held.bounds[::2], held.bounds[1::2], strict=True))
            for stream, held in self._streams.items()
        }

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs, ready for JSON."""
        return {
            "streams": [[actor, incarnation, *held.bounds] for (actor, incarnation), held in self._streams.items()],
            "closed": self._closed.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Replace the content by that of a `state`; raise CheckpointError when it is malformed."""
        streams: dict[Stream, _Open] = {}
        hosts: dict[str, OrderedDict[Stream, None]] = {}
        now = self._clock()
        try:
            for actor, incarnation, *bounds in state["streams"]:
                ascending = all(a < b for a, b in pairwise(bounds))
                if not isinstance(actor, str) or len(bounds) % 2 or not ascending:
                    raise ValueError(f"the stream of {actor!r} is damaged")
                streams[actor, int(incarnation)] = _Open([int(bound) for bound in bounds], now)
                hosts.setdefault(self._host_of(actor), OrderedDict())[actor, int(incarnation)] = None
            closed = _Ends()
            if "closed" in state:
                closed.restore(state["closed"])
        except (KeyError, TypeError, ValueError) as error:
            raise CheckpointError(f"the saved set of stored deliveries cannot be read: {error}") from None
        self._streams, self._hosts, self._closed = streams, hosts, closed

    def _touch(self, stream: Stream) -> _Open:
        """Return a stream that speaks now, opened if need be."""
        now = self._clock()
        own = self._hosts.setdefault(self._host_of(stream[0]), OrderedDict())
        held = self._streams.get(stream)
        if held is None:
            end = self._closed.end(stream)
            held = self._streams[stream] = _Open([0, end] if end else [], now)
            own[stream] = None
            if len(own) > MAX_OPEN_PER_HOST:
                self._close(next(iter(own)))
        else:
            own.move_to_end(stream)
            held.heard = now
        return held

    def _close(self, stream: Stream) -> None:
        self._closed.put(stream, self._streams.pop(stream).bounds[-1])
        host = self._host_of(stream[0])
        del self._hosts[host][stream]
        if not self._hosts[host]:
            del self._hosts[host]


class _Ends:
    """The end of each closed stream, by a keyed digest of its name that nobody outside can aim at: 16 bytes each."""

    def __init__(self) -> None:
        self._key = secrets.token_bytes(16)
        self._names: NDArray[np.uint64] = np.zeros(0, dtype=np.uint64)
        self._ends: NDArray[np.uint64] = np.zeros(0, dtype=np.uint64)
        self._fresh: dict[int, int] = {}

    def __len__(self) -> int:
        return len(self._names) + len(self._fresh)

    def end(self, stream: Stream) -> int:
        """Return the number behind the last one stored of a stream, 0 for a stream that is not here."""
        name = self._digest(stream)
        found = self._fresh.get(name)
        if found is not None:
            return found
        place = int(np.searchsorted(self._names, np.uint64(name)))
        return int(self._ends[place]) if place < len(self._names) and int(self._names[place]) == name else 0

    def put(self, stream: Stream, end: int) -> None:
        """Keep the end of a stream."""
        self._fresh[self._digest(stream)] = end
        if len(self._fresh) >= _MERGE_EVERY:
            self._merge()

    def total(self, without: dict[Stream, _Open]) -> int:
        """Return the number of deliveries of all streams but those of ``without``, which are open again."""
        self._merge()
        return int(self._ends.sum()) - sum(self.end(stream) for stream in without)

    def state(self) -> dict[str, str]:
        """Return all that `restore` needs, ready for JSON."""
        self._merge()
        pairs = np.stack([self._names, self._ends], axis=1).astype("<u8").tobytes()
        return {"key": self._key.hex(), "ends": base64.b64encode(pairs).decode()}

    def restore(self, state: dict[str, str]) -> None:
        """Replace the content; raise ValueError, TypeError or KeyError when the state is malformed."""
        key = bytes.fromhex(state["key"])
        pairs = np.frombuffer(base64.b64decode(state["ends"], validate=True), dtype="<u8").reshape(-1, 2)
        names = pairs[:, 0].astype(np.uint64)
        if len(key) != 16 or (names[1:] <= names[:-1]).any():
            raise ValueError("the list of closed streams is damaged")
        self._key, self._names, self._ends, self._fresh = key, names, pairs[:, 1].astype(np.uint64), {}

    def _merge(self) -> None:
        if not self._fresh:
            return
        names = np.concatenate([np.fromiter(self._fresh.keys(), np.uint64, len(self._fresh)), self._names])
        ends = np.concatenate([np.fromiter(self._fresh.values(), np.uint64, len(self._fresh)), self._ends])
        # Of a name that stands twice the first one, which is fresh, holds.
        self._names, first = np.unique(names, return_index=True)
        self._ends = ends[first]
        self._fresh = {}

    def _digest(self, stream: Stream) -> int:
        text = f"{stream[0]}/{stream[1]}".encode()
        return int.from_bytes(hashlib.blake2b(text, digest_size=8, key=self._key).digest(), "little")
