"""Which deliveries have been stored: what turns at-least-once delivery into exactly-once storage."""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from itertools import pairwise
from typing import Any

from common.errors import CheckpointError

MAX_RANGES = 256
MAX_STREAMS = 10_000


class SeenSet:
    """Sequence numbers per (actor, incarnation), held as ranges: one range per stream when nothing is missing.

    A learner that restarts from an older state leaves a gap for what the actors know to be delivered; ranges hold
    such gaps at no cost. Beyond 256 ranges in one stream the two oldest are joined, and beyond 10,000 streams the
    one that was silent longest is forgotten: both are far outside what an actor with its window of at most 32
    can reach.
    """

    def __init__(self) -> None:
        # Each stream: ascending, disjoint bounds [first, end, first, end, ...], each end exclusive.
        self._streams: OrderedDict[tuple[str, int], list[int]] = OrderedDict()

    def __len__(self) -> int:
        return sum(sum(bounds[1::2]) - sum(bounds[::2]) for bounds in self._streams.values())

    def __contains__(self, delivery: tuple[str, int, int]) -> bool:
        actor, incarnation, sequence = delivery
        bounds = self._streams.get((actor, incarnation), [])
        return bool(bisect_right(bounds, sequence) & 1)

    def add(self, actor: str, incarnation: int, sequence: int) -> bool:
        """Add a delivery; return False when it was there already."""
        stream = (actor, incarnation)
        bounds = self._streams.setdefault(stream, [])
        self._streams.move_to_end(stream)
        place = bisect_right(bounds, sequence)
        if place & 1:
            return False
        # The new range [sequence, sequence + 1) swallows the bounds that it touches on either side.
        joins_left = place > 0 and bounds[place - 1] == sequence
        joins_right = place < len(bounds) and bounds[place] == sequence + 1
        low, high = place - joins_left, place + joins_right
        bounds[low:high] = ([] if joins_left else [sequence]) + ([] if joins_right else [sequence + 1])
        if len(bounds) > 2 * MAX_RANGES:
            del bounds[1:3]
        if len(self._streams) > MAX_STREAMS:
            self._streams.popitem(last=False)
        return True

    def streams(self) -> dict[tuple[str, int], list[tuple[int, int]]]:
        """Return the ranges [first, end) of each (actor, incarnation)."""
        return {stream: list(zip(bounds[::2], bounds[1::2], strict=True)) for stream, bounds in self._streams.items()}

    def state(self) -> dict[str, Any]:
        """Return all that `restore` needs, ready for JSON."""
        return {"streams": [[actor, incarnation, *bounds] for (actor, incarnation), bounds in self._streams.items()]}

    def restore(self, state: dict[str, Any]) -> None:
        """Replace the content by that of a `state`; raise CheckpointError when it is malformed."""
        streams: OrderedDict[tuple[str, int], list[int]] = OrderedDict()
        try:
            for actor, incarnation, *bounds in state["streams"]:
                ascending = all(a < b for a, b in pairwise(bounds))
                if not isinstance(actor, str) or len(bounds) % 2 or not ascending:
                    raise ValueError(f"the stream of {actor!r} is damaged")
                streams[actor, int(incarnation)] = [int(bound) for bound in bounds]
        except (KeyError, TypeError, ValueError) as error:
            raise CheckpointError(f"the saved set of stored deliveries cannot be read: {error}") from None
        self._streams = streams
