"""What people see of a running learner: a live view in a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.columns import Columns
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from common.system.threads import Complaints
from learner.watch.status import ActorStatus, LearnerStatus

logger = logging.getLogger(__name__)

REFRESH_SECONDS = 0.5
LINE_SECONDS = 30.0
MAX_ACTORS = 24

_STATE_STYLE = {
    "training": "bold green",
    "cloning": "bold green",
    "complete": "bold green",
    "collecting": "bold yellow",
    "waiting": "yellow",
    "paused": "bold magenta",
    "stopping": "bold red",
    "disk full": "bold red",
    "held": "bold red",
}
_GROUP_TITLE = {"train": "policy, training", "expert": "expert, training", "evaluate": "evaluation"}


class View:
    """Shows the status until it is closed: a live view when the console is a terminal, log lines otherwise.

    Usage::

        with View(trainer.status, console):
            ...

    Args:
        status: returns the newest status; called from a thread of the view.
        console: shared with the log, so that its lines appear above the view.
        line_seconds: seconds between two plain lines.
    """

    def __init__(
        self, status: Callable[[], LearnerStatus], console: Console, line_seconds: float = LINE_SECONDS
    ) -> None:
        self._status = status
        self._console = console
        self._line_seconds = line_seconds
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop showing; safe to call twice."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        complaints = Complaints("the view of the learner")
        if self._console.is_terminal:
            with Live(console=self._console, auto_refresh=False, transient=True) as live:
                while not self._closed.is_set():
                    with complaints:
                        live.update(render(self._status()), refresh=True)
                    self._closed.wait(REFRESH_SECONDS)
        else:
            while not self._closed.wait(self._line_seconds):
                with complaints:
                    logger.info("%s", line(self._status()))


def line(status: LearnerStatus) -> str:
    """Put the most important figures into one line."""
    parts = [
        status.state,
        f"{status.steps:,} steps ({status.steps_per_second:.1f}/s)",
        f"{status.updates:,} updates ({status.updates_per_second:.2f}/s)",
        f"replay {status.replay_fill:.0%}",
        f"version {status.version}",
        f"{_alive(status.actors, 'actor')} actors",
    ]
    for group, means in status.late.items():
        parts.append(f"{group} {means.distance:.0f} m, {means.success:.0%} complete")
    if status.hold:
        parts.append(f"actors held {status.hold:.1f} s")
    return ", ".join(parts)


def render(status: LearnerStatus) -> RenderableType:
    """Lay the whole status out for a terminal of 80 columns or more."""
    return Group(
        Panel(
            Group(_figures(status), _losses(status)),
            title=Text.assemble(("HDPlanner ", "bold"), status.run, "  ", _state(status)),
            subtitle=Text(f"{status.endpoint or 'serial'}   {status.folder}   {status.device}", style="dim"),
        ),
        _episodes(status),
        _Actors(status),
    )


def _state(status: LearnerStatus) -> tuple[str, str]:
    return status.state, _STATE_STYLE.get(status.state, "bold")


def _figures(status: LearnerStatus) -> RenderableType:
    collected = _grid()
    _row(collected, "collected", f"{status.steps:,} steps", f"{status.steps_per_second:.1f}/s")
    _row(collected, "episodes", f"{status.episodes:,}", "")
    _row(collected, "replay", f"{status.replay:,}", f"{status.replay_fill:.0%}, {status.replay_bytes / 1e6:.0f} MB")
    _row(collected, "", ProgressBar(total=1.0, completed=status.replay_fill, width=9), "")
    refused = f"{status.refused:,} refused" if status.refused else "all valid"
    _row(collected, "messages", refused, "")
    trained = _grid()
    _row(trained, "updates", f"{status.updates:,}", f"{status.updates_per_second:.2f}/s")
    _row(trained, "", ProgressBar(total=status.total_updates, completed=status.updates, width=9), _ahead(status))
    _row(trained, "ratio", f"{status.ratio_actual:.4f}", f"declared {status.ratio_declared:.4g}")
    _row(trained, "version", f"{status.version}", f"best {status.best}" if status.best >= 0 else "none evaluated")
    last = status.last_checkpoint.lstrip("0") or "0"
    _row(trained, "checkpoint", f"at {last}", f"next in {status.next_checkpoint:.0f} s")
    table = Table.grid(padding=(0, 1), expand=True)
    table.add_column(ratio=1)
    table.add_column(ratio=1)
    table.add_row(collected, trained)
    return table


def _ahead(status: LearnerStatus) -> str:
    if status.hold:
        return f"actors wait {status.hold:.1f} s"
    return f"of {status.total_updates:,}"


def _grid() -> Table:
    table = Table.grid(padding=(0, 1))
    table.add_column(style="cyan", min_width=9, no_wrap=True)
    table.add_column(min_width=9, no_wrap=True)
    table.add_column(style="dim", no_wrap=True)
    return table


def _row(table: Table, name: str, value: RenderableType, note: str) -> None:
    table.add_row(name, value, note)


def _losses(status: LearnerStatus) -> RenderableType:
    if not status.losses:
        return Text("no update yet", style="dim")
    cells = [
        Text.assemble((name, "cyan"), " ", f"{value:.4g}")
        for name, value in sorted(status.losses.items())
        if not name.startswith("gradient/")
    ]
    return Columns(cells, padding=(0, 2), equal=True)


def _episodes(status: LearnerStatus) -> RenderableType:
    table = _table("late episodes of")
    for title in ("number", "distance", "success", "explored", "steps", "reward", "hits"):
        table.add_column(title, justify="right", no_wrap=True)
    for group, means in status.late.items():
        table.add_row(
            _GROUP_TITLE.get(group, group),
            f"{means.count}",
            f"{means.distance:.1f} m",
            f"{means.success:.0%}",
            f"{means.explored:.1%}",
            f"{means.steps:.1f}",
            f"{means.reward:.2f}",
            f"{means.collisions:.1f}",
        )
    if not status.late:
        table.add_row(Text("none yet", style="dim"))
    return table


def _table(first: str) -> Table:
    table = Table(expand=True, box=None, header_style="bold cyan", pad_edge=False)
    table.add_column(first, no_wrap=True, overflow="ellipsis")
    return table


class _Actors:
    """Table of the actors; narrow terminals do without episodes, machines and queues, and cut the state's end off."""

    def __init__(self, status: LearnerStatus) -> None:
        self._status = status

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        actors = self._status.actors
        wide = options.max_width >= 110
        title = f"alive: {_count(actors, 'actor')}"
        if _alive(actors, "evaluator"):
            title += f", {_count(actors, 'evaluator')}"
        table = _table(title)
        for heading in ("steps/s", "stored", "version", "behind", "heard", *(("queue", "episodes") if wide else ())):
            table.add_column(heading, justify="right", no_wrap=True)
        if wide:
            table.add_column("machine", no_wrap=True)
        # With a ratio it takes what the others leave; without one, a long state would shorten their figures.
        table.add_column("state", no_wrap=True, overflow="ellipsis", ratio=1)
        for actor in actors[:MAX_ACTORS]:
            table.add_row(*_actor_row(actor, wide), style="" if actor.alive else "dim")
        hidden = len(actors) - MAX_ACTORS
        if hidden > 0:
            table.add_row(Text(f"and {hidden} more", style="dim"))
        if not actors:
            table.add_row(Text("`hd-actor` starts some", style="dim"))
        yield table


def _actor_row(actor: ActorStatus, wide: bool) -> list[RenderableType]:
    cells: list[RenderableType] = [
        Text(actor.name),
        f"{actor.steps_per_second:.1f}",
        f"{actor.steps:,}",
        f"{actor.version}" if actor.version >= 0 else "-",
        f"{actor.lag} ({actor.lag_seconds:.0f} s)" if actor.version >= 0 else "-",
        f"{actor.silent:.0f} s" if actor.silent >= 0 else "-",
    ]
    if wide:
        cells += [f"{actor.buffered}", f"{actor.episodes:,}", Text(actor.host)]
    cells.append(Text(actor.state) if actor.alive else Text("gone", style="red"))
    return cells


def _count(actors: list[ActorStatus], role: str) -> str:
    alive = _alive(actors, role)
    return f"{alive} {role}{'' if alive == 1 else 's'}"


def _alive(actors: list[ActorStatus], role: str) -> int:
    return sum(actor.alive and actor.role == role for actor in actors)
