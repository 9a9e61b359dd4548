"""What waits for an answer: sources take turns, and when there is no room the largest one pays."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(slots=True)
class _Source(Generic[T]):
    items: deque[tuple[T, float]] = field(default_factory=deque)
    weight: float = 0.0


class FairQueue(Generic[T]):
    """A bounded queue that serves its sources in turn, and each source in the order of its items.

    Nobody waits longer because somebody else sends more: a flood waits behind itself. When the queue is full, the
    newest items of the source that fills most of it make room for those of the others. An item fills what is the larger
    share, of the number of items or of the bytes.

    Args:
        max_items: that wait at most.
        max_bytes: that they hold together at most.
    """

    def __init__(self, max_items: int, max_bytes: int) -> None:
        self._max_items = max_items
        self._max_bytes = max_bytes
        self._sources: OrderedDict[str, _Source[T]] = OrderedDict()
        self._weight = 0.0
        self._changed = threading.Condition()
        self._closed = False

    def put(self, source: str, item: T, size: int) -> list[T]:
        """Add an item of a source; return those that there is no room for: of a closed queue, the item itself.

        Args:
            source: whose item it is.
            item: of any kind.
            size: bytes that it holds.
        """
        weight = max(1.0 / self._max_items, size / self._max_bytes)
        refused: list[T] = []
        with self._changed:
            if self._closed or weight > 1.0:
                return [item]
            own = self._sources.get(source)
            after = weight + (own.weight if own else 0.0)
            while self._weight + weight > 1.0 + 1e-9:
                largest = max(self._sources, key=lambda name: self._sources[name].weight)
                # Whoever would then be the largest itself has nothing to claim.
                if after >= self._sources[largest].weight:
                    return [*refused, item]
                refused.append(self._take(largest, -1))
            own = self._sources.setdefault(source, _Source())
            own.items.append((item, weight))
            own.weight += weight
            self._weight += weight
            self._changed.notify()
        return refused

    def get(self) -> T | None:
        """Wait for the next item, of the source whose turn it is; None once the queue is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._sources)
            if self._closed:
                return None
            source = next(iter(self._sources))
            item = self._take(source, 0)
            if source in self._sources:
                self._sources.move_to_end(source)
            return item

    def close(self) -> list[T]:
        """Let nothing in and nobody wait any more; return what still waited."""
        with self._changed:
            self._closed = True
            left = [item for source in self._sources.values() for item, _ in source.items]
            self._sources.clear()
            self._weight = 0.0
            self._changed.notify_all()
        return left

    def _take(self, source: str, end: int) -> T:
        """Take a source's oldest (0) or newest (-1) item."""
        own = self._sources[source]
        item, weight = own.items.popleft() if end == 0 else own.items.pop()
        own.weight -= weight
        self._weight -= weight
        if not own.items:
            del self._sources[source]
        if not self._sources:
            self._weight = 0.0  # no rest of rounding
        return item
