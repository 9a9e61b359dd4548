"""`hd-deploy demo`: a robot explores before your eyes, and leaves a video."""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from actors.evaluation.video import write_frames
from common.page.hub import PageError
from common.page.options import PageSettings
from common.system.extras import MissingPackageError
from deploy.config import DeployConfig
from deploy.page.process import start_page
from deploy.robot.film import Shot, frames
from deploy.robot.terminal import live_view
from deploy.robot.trial import Trial, Verdict

log = logging.getLogger(__name__)

DEFAULT_PAGE = "8080"
"""Port of the page unless another one is asked for."""

_PLAIN_SECONDS = 10.0


def run_demo(
    trial: Trial,
    folder: Path,
    limit: float,
    stop: threading.Event,
    console: Console,
    video: str | None,
    page: Callable[[DeployConfig], AbstractContextManager[object]] = nullcontext,
) -> Verdict:
    """Run a trial with a live view, and write its video and its verdict.

    Args:
        trial: prepared.
        folder: where ``video`` and ``verdict.json`` go.
        limit: seconds of the robot.
        stop: ends it early.
        console: where the live view is shown; a line every ten seconds where it is no terminal with UTF-8.
        video: file name that ends in .mp4 or .gif; None for none.
        page: shows the robot elsewhere too, given the settings of its network; see `demo_page`.
    """
    # Half blocks need a terminal that can show them.
    pictures = console.is_terminal and console.encoding.startswith("utf")
    with Live(console=console, refresh_per_second=4, transient=False, auto_refresh=False) as live:
        next_line = 0.0

        def tell(shot: Shot, truth: dict[str, Any], status: dict[str, Any]) -> None:
            nonlocal next_line
            if not pictures:
                if shot.time >= next_line:
                    next_line = shot.time + _PLAIN_SECONDS
                    log.info("%s: %s", shot.words, status["reason"])
                return
            way = [earlier.pose.position for earlier in trial.shots]
            waypoint = shot.path[0] if shot.path else None
            columns = min(console.width, 2 * max(console.height - 14, 10))
            belief = None if shot.belief is None else shot.belief.grid()
            live.update(live_view(belief, shot.pose, way, waypoint, _lines(trial, truth, status), columns))
            live.refresh()

        def prepare(line: str) -> None:
            # What a bridge logs begins with time, level and module.
            message = line.partition(": ")[2] or line
            if pictures:
                live.update(Text(f"the bridge starts: {message}", style="dim"), refresh=True)
            else:
                log.info("the bridge starts: %s", message)

        try:
            verdict = trial.run(limit, stop, tell, page, prepare)
        finally:
            if video is not None and trial.shots:
                path = folder / video
                count = write_frames(frames(trial.shots, trial.world, trial.target), path)
                log.info("%d pictures are in %s", count, path)
    (folder / "verdict.json").write_text(json.dumps(verdict.to_json(), indent=2) + "\n", "utf-8")
    return verdict


@contextmanager
def demo_page(settings: PageSettings, config: DeployConfig, *, insist: bool) -> Iterator[None]:
    """Show the robot in a browser within the `with`, and open one where there is a display.

    Args:
        settings: of the page.
        config: of the robot's network.
        insist: fail where the page cannot be had; otherwise it takes another port where its own is taken, and the
            demonstration does without it where the extra `page` is not installed, and says so.

    Raises:
        PageError: the page cannot be served there.
        ConfigError: the extra is not installed.
    """
    with ExitStack() as parts:
        try:
            page = parts.enter_context(start_page(settings, config))
        except PageError:
            if insist:
                raise
            page = parts.enter_context(start_page(replace(settings, port=0), config))
        except MissingPackageError as error:
            if insist:
                raise
            log.warning("without a page: %s", error)
            yield
            return
        address = f"{page.address}#token={settings.token}"
        log.info("watch and command it at %s", address)
        if sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
            webbrowser.open(address)
        yield


def _lines(trial: Trial, truth: dict[str, Any], status: dict[str, Any]) -> dict[str, Any]:
    return {
        "state": f"{status['state']}: {status['reason']}",
        "planner": f"{status['planner']}, p95 of decisions {1e3 * status['decision_p95']:.0f} ms",
        "explored": f"{trial.explored:.1%} of what can be reached, {status['explored_area']:.0f} m2",
        "graph": f"{status['viewpoints']} viewpoints, {status['frontiers']} frontiers, {status['beacons']} beacons",
        "robot": f"{truth['distance']:.1f} m in {truth['time']:.0f} s, now {round(truth['speed'], 2) + 0.0:.2f} m/s, "
        f"{truth['collisions']} collisions, {truth['real_time_factor']:.2f} times real time",
        "watchdog": status["gate"],
    }
