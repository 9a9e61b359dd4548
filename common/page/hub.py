"""The newest state of everything that a page shows, and what each browser has of it already.

Nothing is queued for a browser. A view holds one number per channel, how far its browser has come, and what it lacks is
made when it can be sent: a browser that is slow, or dead, skips what is old and costs no memory. What several browsers
lack is made once.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from common.errors import HDError
from common.page.protocol import MAX_NAME, to_text
from common.page.tiles import TileGrid

MAX_CHANNELS: Final = 4096
MAX_VALUE: Final = 2 << 20
"""Longest value of a channel, characters of JSON."""
MAX_ITEMS: Final = 20_000
"""Newest items of a series that are kept."""

Frame = str | bytes
"""A text frame (values and series) or a binary one (tiles of a grid)."""


class PageError(HDError):
    """A page cannot be served, or a source puts what a page cannot show."""


class _Channel(Protocol):
    """What a hub needs of a channel."""

    @property
    def revision(self) -> int:
        """Number of the newest change; 0 while there is nothing to show."""
        ...

    def since(self, cursor: int) -> Frame:
        """Return what changed after a revision."""
        ...


class _Value:
    """The newest of a kind, as JSON."""

    def __init__(self) -> None:
        self.revision = 0
        self._text = "null"

    def put(self, text: str) -> bool:
        if self.revision and text == self._text:
            return False
        self._text = text
        self.revision += 1
        return True

    def since(self, cursor: int) -> str:
        del cursor
        return self._text


class _Series:
    """Items that are appended, the newest `MAX_ITEMS` of them; the revision counts them."""

    def __init__(self) -> None:
        self.revision = 0
        self._items: deque[str] = deque(maxlen=MAX_ITEMS)

    def append(self, text: str) -> None:
        self._items.append(text)
        self.revision += 1

    def clear(self) -> None:
        self._items.clear()
        # A gap in the numbers tells readers to forget what they have.
        self.revision += 1

    def since(self, cursor: int) -> str:
        count = min(self.revision - cursor, len(self._items))
        items = [self._items[i] for i in range(len(self._items) - count, len(self._items))]
        return f'{{"start":{self.revision - count},"items":[{",".join(items)}]}}'


class View:
    """What one browser watches, and what it has.

    Attributes:
        patterns: names of channels; one that ends in ``*`` stands for all that begin so.
    """

    def __init__(self) -> None:
        self.patterns: tuple[str, ...] = ()
        self._cursors: dict[str, tuple[_Channel, int]] = {}
        self._generation = -1

    def watch(self, patterns: Sequence[str]) -> None:
        """Watch these channels from now on; what the browser has of those that remain, it keeps."""
        self.patterns = tuple(patterns)
        self._generation = -1

    def wants(self, name: str) -> bool:
        """Whether it watches a channel."""
        return any(
            name.startswith(pattern[:-1]) if pattern.endswith("*") else name == pattern for pattern in self.patterns
        )


class Hub:
    """The channels of a page; safe to use from several threads.

    Usage::

        hub.put("robot/robot/status", {"state": "running"})
        hub.append("robot/robot/way", [1.25, 3.5])
        hub.grid("robot/robot/belief", cells, 0.2, (-10.0, -4.0))
        hub.drop("robot/robot/")
    """

    def __init__(self) -> None:
        """Begin without channels and views."""
        self._lock = threading.Lock()
        self._channels: dict[str, _Channel] = {}
        self._generation = 0
        self._views: list[View] = []
        self._made: dict[tuple[str, int], Frame] = {}
        self._bundles: dict[tuple[tuple[str, int], ...], str] = {}

    def put(self, name: str, value: Any) -> None:
        """Put the newest value of a channel; one that is as before costs nothing.

        Raises:
            PageError: it is no JSON, larger than `MAX_VALUE`, or the channel is of another kind.
        """
        text = _encoded(name, value)
        with self._lock:
            if self._channel(name, _Value).put(text):
                self._changed()

    def append(self, name: str, item: Any) -> None:
        """Append an item to a series, of which the newest `MAX_ITEMS` are kept.

        Raises:
            PageError: as of `put`.
        """
        text = _encoded(name, item)
        with self._lock:
            self._channel(name, _Series).append(text)
            self._changed()

    def clear(self, name: str) -> None:
        """Empty a series: browsers forget what they have of it."""
        with self._lock:
            self._channel(name, _Series).clear()
            self._changed()

    def grid(self, name: str, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float]) -> None:
        """Put the newest grid of a channel; its changed tiles are found here.

        Args:
            name: of the channel.
            cells: as a ROS OccupancyGrid has them (-1, 0 to 100), shape (rows, columns).
            resolution: metres.
            origin: lower left corner of the first cell, metres.

        Raises:
            PageError: the channel is of another kind.
            MessageError: the grid is too large.
        """
        with self._lock:
            if self._channel(name, TileGrid).update(cells, resolution, origin):
                self._changed()

    def drop(self, prefix: str) -> None:
        """Forget the channels whose names begin so; browsers are told."""
        with self._lock:
            gone = [name for name in self._channels if name.startswith(prefix)]
            for name in gone:
                del self._channels[name]
            if gone:
                self._generation += 1
                self._changed()

    def watched(self, name: str) -> bool:
        """Whether some browser watches a channel, so that a source can leave out what is costly and unseen."""
        with self._lock:
            return any(view.wants(name) for view in self._views)

    def patterns(self) -> frozenset[str]:
        """Return the patterns of all browsers; a source whose channels are many finds the watched ones among them."""
        with self._lock:
            return frozenset(pattern for view in self._views for pattern in view.patterns)

    @property
    def views(self) -> int:
        """Browsers at this moment."""
        with self._lock:
            return len(self._views)

    def join(self) -> View:
        """Return the view of a new browser."""
        view = View()
        with self._lock:
            self._views.append(view)
        return view

    def leave(self, view: View) -> None:
        """Forget the view of a browser that has gone; safe to call twice."""
        with self._lock:
            if view in self._views:
                self._views.remove(view)

    def collect(self, view: View) -> list[Frame]:
        """Return the frames that bring a browser up to date, and count them as sent: at most one text, then grids."""
        with self._lock:
            gone = self._follow_channels(view)
            behind = [(name, cursor) for name, (channel, cursor) in view._cursors.items() if channel.revision != cursor]
            if not behind and not gone:
                return []
            for name, _ in behind:
                channel = self._channels[name]
                view._cursors[name] = channel, channel.revision
            grids = [each for each in behind if isinstance(self._channels[each[0]], TileGrid)]
            plain = tuple(each for each in behind if each not in grids)
            frames: list[Frame] = [self._bundle(plain, gone)] if plain or gone else []
            return [*frames, *(self._part(*each) for each in grids)]

    def _follow_channels(self, view: View) -> list[str]:
        """Keep a view's cursors in step with the channels, and return those that are gone."""
        if view._generation == self._generation:
            return []
        view._generation = self._generation
        before = view._cursors
        view._cursors = {}
        for name, channel in self._channels.items():
            if view.wants(name):
                # A channel that was dropped and came again is another one.
                known, cursor = before.get(name, (channel, 0))
                view._cursors[name] = channel, cursor if known is channel else 0
        return [name for name in before if name not in self._channels]

    def _bundle(self, plain: tuple[tuple[str, int], ...], gone: list[str]) -> str:
        found = None if gone else self._bundles.get(plain)
        if found is None:
            found = "".join(self._bundle_parts(plain, gone))
            if not gone:
                self._bundles[plain] = found
        return found

    def _bundle_parts(self, plain: tuple[tuple[str, int], ...], gone: list[str]) -> Iterator[str]:
        yield '{"type":"update"'
        for kind, of in (("values", _Value), ("series", _Series)):
            inner = ",".join(
                f"{to_text(name)}:{self._part(name, cursor)!s}"
                for name, cursor in plain
                if isinstance(self._channels[name], of)
            )
            if inner:
                yield f',"{kind}":{{{inner}}}'
        if gone:
            yield f',"gone":{to_text(gone)}'
        yield "}"

    def _part(self, name: str, cursor: int) -> Frame:
        found = self._made.get((name, cursor))
        if found is None:
            found = self._made[name, cursor] = self._channels[name].since(cursor)
        return found

    def _channel(self, name: str, kind: type[Any]) -> Any:
        found = self._channels.get(name)
        if found is None:
            if len(self._channels) >= MAX_CHANNELS or not 0 < len(name.encode()) <= MAX_NAME:
                raise PageError(
                    f"a page has at most {MAX_CHANNELS} channels with names of 1 to {MAX_NAME} bytes: got {name[:40]!r}"
                )
            found = TileGrid(name) if kind is TileGrid else kind()
            self._channels[name] = found
            self._generation += 1
        elif not isinstance(found, kind):
            raise PageError(f"channel {name!r} is of another kind: give each kind a name of its own")
        return found

    def _changed(self) -> None:
        self._made.clear()
        self._bundles.clear()


def _encoded(name: str, value: Any) -> str:
    try:
        text = to_text(value)
    except (TypeError, ValueError) as error:
        raise PageError(f"channel {name!r} cannot be sent as JSON: {error}") from None
    if len(text) > MAX_VALUE:
        raise PageError(f"channel {name!r} must have at most {MAX_VALUE} characters of JSON, got {len(text)}")
    return text
