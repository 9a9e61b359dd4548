"""One thread of a node in which all its callbacks run, behind bounded queues."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from common.system.closing import Closing

T = TypeVar("T")


class Inbox(Generic[T]):
    """The newest `depth` items that wait for one callback; Zenoh's threads put, the dispatcher takes.

    Attributes:
        dropped: items that newer ones pushed out.
    """

    def __init__(self, dispatcher: Dispatcher, depth: int, callback: Callable[[T], None]) -> None:
        self.dropped = 0
        self._dispatcher = dispatcher
        self._callback = callback
        self._items: deque[T] = deque(maxlen=depth)
        self._closed = False

    def put(self, item: T) -> None:
        """Add an item; never blocks."""
        with self._dispatcher.condition:
            if self._closed:
                return
            self.dropped += len(self._items) == self._items.maxlen
            self._items.append(item)
            self._dispatcher.announce(self)

    def close(self) -> None:
        """Drop what waits, and take no more."""
        with self._dispatcher.condition:
            self._closed = True
            self._items.clear()

    def serve(self) -> None:
        """Call the callback with the oldest item."""
        with self._dispatcher.condition:
            if not self._items:
                return
            item = self._items.popleft()
            if self._items:
                self._dispatcher.announce(self)
        self._callback(item)


class Dispatcher(Closing):
    """Runs callbacks one after another in a thread of its own, so that they need no locks among themselves.

    Attributes:
        condition: guards all inboxes.
    """

    def __init__(self, name: str) -> None:
        self.condition = threading.Condition()
        self._ready: deque[Inbox[Any]] = deque()
        self._waiting: set[int] = set()
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def announce(self, inbox: Inbox[Any]) -> None:
        """Put an inbox in the line, once; the caller holds `condition`."""
        if id(inbox) not in self._waiting:
            self._waiting.add(id(inbox))
            self._ready.append(inbox)
            self.condition.notify()

    def close(self) -> None:
        """Stop after the callback that runs now; what still waits is dropped."""
        with self.condition:
            self._closed = True
            self.condition.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self.condition:
                while not self._ready and not self._closed:
                    self.condition.wait()
                if self._closed:
                    return
                inbox = self._ready.popleft()
                self._waiting.discard(id(inbox))
            inbox.serve()
