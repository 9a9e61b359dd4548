"""The smallest page: a process with one value, one series, one grid and two commands."""

import threading

import numpy as np

from common.errors import HDError
from common.page.serve import page_main
from common.page.source import Site, Source

blocked = threading.Event()


class Clock(Source):
    verbs = ("wait", "stop", "refuse", "break", "drop")
    urgent = ("stop",)

    def __init__(self, wide):
        self.ticks = 0
        self.wide = wide
        self.dropped = False

    def refresh(self, hub):
        self.ticks += 1
        if self.dropped:
            self.dropped = False
            hub.drop("clock/")
            return
        hub.put("clock/ticks", {"ticks": self.ticks, "watched": hub.watched("clock/dear")})
        hub.append("clock/series", self.ticks)
        cells = np.full((100, 130), -1, np.int8)
        cells[: self.ticks % 100, 3:90] = 0
        cells[self.ticks % 100, 5] = 100
        hub.grid("clock/grid", cells, 0.25, (-2.0, 1.5))
        if self.wide:
            hub.put("clock/wide", [self.ticks] * self.wide)

    def carry_out(self, command):
        if command.verb == "wait":
            blocked.wait(20)
        elif command.verb == "stop":
            blocked.set()
        elif command.verb == "drop":
            self.dropped = True
        elif command.verb == "refuse":
            raise HDError(f"not {command.arguments}")
        elif command.verb == "break":
            raise RuntimeError("broken")
        return {"verb": command.verb, "target": command.target}


def make(request):
    from pathlib import Path

    return Site("clock", Path(request["folder"])), Clock(request.get("wide", 0))


if __name__ == "__main__":
    page_main(make)
