"""Episodes on a page: those that somebody looks at, and those of evaluation, world by world."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from common.bus.liveness import Process
from common.bus.views import ViewWatcher
from common.messages.places import centimetres
from common.messages.view import EpisodeView
from common.page.hub import Hub

MAX_WORLDS: Final = 128
"""Worlds of evaluation on the page; those not evaluated for the longest time go."""
_MAX_RESULTS: Final = 60
_EVALUATIONS: Final = "evaluations"


class LiveViews:
    """The episodes of the actors whose channels (``actor/NAME/*``) somebody watches."""

    def __init__(self) -> None:
        """Begin with nobody watched."""
        self._looked_at: frozenset[Process] = frozenset()

    def refresh(self, hub: Hub, watcher: ViewWatcher, roles: Mapping[str, str]) -> None:
        """Look at whom the browsers watch, and put what came of them.

        Args:
            hub: of the page.
            watcher: gets the views.
            roles: of all actors, by name.
        """
        named = (pattern.split("/")[1] for pattern in hub.patterns() if pattern.startswith("actor/"))
        wanted = frozenset((roles[name], name) for name in named if name in roles)
        for _, name in self._looked_at - wanted:
            hub.drop(f"actor/{name}/")
        self._looked_at = wanted
        watcher.look_at(wanted)
        for (_, name), view in watcher.views().items():
            put_view(hub, f"actor/{name}", view)


class Evaluations:
    """How policies did in each world of validation, and what the newest episode there looked like when it ended."""

    def __init__(self) -> None:
        """Begin without results."""
        self._worlds: OrderedDict[tuple[str, str, str], _World] = OrderedDict()
        self._numbers = 0

    def load(self, hub: Hub, lines: Iterable[Mapping[str, Any]]) -> None:
        """Begin with the results of the time before the page: lines of `episodes.jsonl`."""
        for line in lines:
            world = self._world(hub, str(line.get("family", "worlds")), line["task"], line["map_name"])
            world.note(line["version"], line["success"], line["distance"], line["explored"])
        self._put(hub)

    def add(self, hub: Hub, views: Iterable[EpisodeView]) -> None:
        """Add episodes of evaluation that have ended."""
        changed = False
        for view in views:
            world = self._world(hub, view.family, view.task, view.world)
            world.note(view.version, view.success, view.distance, view.explored)
            world.seen = True
            put_view(hub, f"world/{world.number}", view)
            changed = True
        if changed:
            self._put(hub)

    def _world(self, hub: Hub, family: str, task: str, name: str) -> _World:
        key = family, task, name
        if key not in self._worlds:
            self._worlds[key] = _World(self._numbers, family, task, name)
            self._numbers += 1
        self._worlds.move_to_end(key)
        if len(self._worlds) > MAX_WORLDS:
            _, gone = self._worlds.popitem(last=False)
            hub.drop(f"world/{gone.number}/")
        return self._worlds[key]

    def _put(self, hub: Hub) -> None:
        hub.put(_EVALUATIONS, [each.to_json() for each in sorted(self._worlds.values(), key=lambda each: each.number)])


class _World:
    """The results in one world, oldest first."""

    def __init__(self, number: int, family: str, task: str, name: str) -> None:
        self.number = number
        self.seen = False
        self._place = {"family": family, "task": task, "world": name}
        self._results: deque[list[Any]] = deque(maxlen=_MAX_RESULTS)

    def note(self, version: int, success: bool, distance: float, explored: float) -> None:
        self._results.append([version, int(success), round(distance, 1), round(explored, 4)])

    def to_json(self) -> dict[str, Any]:
        return {"id": self.number, **self._place, "seen": self.seen, "results": list(self._results)}


def put_view(hub: Hub, prefix: str, view: EpisodeView) -> None:
    """Put a view as the channels ``PREFIX/view`` and ``PREFIX/belief``; docs/page.md describes both."""
    hub.grid(f"{prefix}/belief", view.cells, view.resolution, view.origin)
    ends = view.viewpoints[view.edges.astype(np.int64)].reshape(-1, 4)
    hub.put(
        f"{prefix}/view",
        {
            **{name: getattr(view, name) for name in ("actor", "family", "world", "task", "driver", "version", "step")},
            "distance": round(view.distance, 2),
            "explored": round(view.explored, 4),
            "ended": view.ended,
            "success": view.success,
            "cell": round(100.0 * view.resolution),
            "viewpoints": centimetres(view.viewpoints, view.kinds),
            "edges": centimetres(ends),
            **{
                name: centimetres(getattr(view, name))
                for name in ("frontiers", "beacons", "way", "beacon", "waypoint", "target")
            },
        },
    )
