"""What people see of a running learner: a live view in a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from learner.status import ActorStatus, LearnerStatus

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
        if self._console.is_terminal:
            with Live(render(self._status()), console=self._console, auto_refresh=False, transient=True) as live:
                while not self._closed.wait(REFRESH_SECONDS):
                    live.update(render(self._status()), refresh=True)
        else:
            while not self._closed.wait(self._line_seconds):
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
    """Lay the whole status out for a terminal."""
    return Group(
        Panel(
            _figures(status),
            title=Text.assemble(("HDPlanner ", "bold"), status.run, "  ", _state(status)),
            subtitle=Text(f"{status.endpoint or 'serial'}   {status.folder}   {status.device}", style="dim"),
        ),
        _episodes(status),
        _actors(status),
    )


def _state(status: LearnerStatus) -> tuple[str, str]:
    return status.state, _STATE_STYLE.get(status.state, "bold")


def _figures(status: LearnerStatus) -> RenderableType:
    table = Table.grid(padding=(0, 2), expand=True)
    for _ in range(3):
        table.add_column(ratio=1)
    collected = Table.grid(padding=(0, 1))
    _row(collected, "collected", f"{status.steps:,} steps", f"{status.steps_per_second:.1f}/s")
    _row(collected, "episodes", f"{status.episodes:,}", "")
    _row(collected, "replay", f"{status.replay:,} of {status.replay_capacity:,}", f"{status.replay_bytes / 1e6:.0f} MB")
    collected.add_row("", ProgressBar(total=1.0, completed=status.replay_fill, width=24), "")
    _row(collected, "refused", f"{status.refused:,} messages" if status.refused else "-", "")
    trained = Table.grid(padding=(0, 1))
    _row(trained, "updates", f"{status.updates:,} of {status.total_updates:,}", f"{status.updates_per_second:.2f}/s")
    trained.add_row("", ProgressBar(total=status.total_updates, completed=status.updates, width=24), "")
    _row(trained, "ratio", f"{status.ratio_actual:.4f}", f"declared {status.ratio_declared:.4f}")
    held = f"actors pause {status.hold:.1f} s" if status.hold else ""
    _row(trained, "lead", f"{status.ratio_lead:,.0f} steps", held)
    _row(trained, "version", f"{status.version}", f"best {status.best}" if status.best >= 0 else "")
    _row(trained, "checkpoint", status.last_checkpoint or "-", f"next in {status.next_checkpoint:.0f} s")
    losses = Table.grid(padding=(0, 1))
    for name, value in sorted(status.losses.items()):
        losses.add_row(Text(name, style="cyan"), Text(f"{value:.4g}", justify="right"))
    if not status.losses:
        losses.add_row(Text("no update yet", style="dim"))
    table.add_row(collected, trained, losses)
    return table


def _row(table: Table, name: str, value: str, note: str) -> None:
    table.add_row(Text(name, style="cyan"), Text(value), Text(note, style="dim"))


def _episodes(status: LearnerStatus) -> RenderableType:
    table = Table(title="late episodes", title_justify="left", expand=True, box=None, header_style="bold cyan")
    table.add_column("episodes of")
    for title in ("number", "distance", "success", "explored", "steps", "reward", "collisions"):
        table.add_column(title, justify="right")
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


def _actors(status: LearnerStatus) -> RenderableType:
    title = f"actors: {_alive(status.actors, 'actor')} alive"
    evaluators = _alive(status.actors, "evaluator")
    if evaluators:
        title += f", {evaluators} evaluating"
    table = Table(title=title, title_justify="left", expand=True, box=None, header_style="bold cyan")
    table.add_column("actor")
    table.add_column("machine")
    for heading in ("steps/s", "stored", "episodes", "version", "behind", "waiting", "last heard"):
        table.add_column(heading, justify="right")
    table.add_column("state")
    for actor in status.actors[:MAX_ACTORS]:
        table.add_row(*_actor_row(actor), style="" if actor.alive else "dim")
    hidden = len(status.actors) - MAX_ACTORS
    if hidden > 0:
        table.add_row(Text(f"and {hidden} more", style="dim"))
    if not status.actors:
        table.add_row(Text("none yet: `hd-actor --num 2` starts some", style="dim"))
    return table


def _actor_row(actor: ActorStatus) -> list[RenderableType]:
    behind = f"{actor.lag} ({actor.lag_seconds:.0f} s)" if actor.version >= 0 else "-"
    return [
        Text(actor.name),
        Text(actor.host),
        f"{actor.steps_per_second:.1f}",
        f"{actor.steps:,}",
        f"{actor.episodes:,}",
        f"{actor.version}" if actor.version >= 0 else "-",
        behind,
        f"{actor.buffered}",
        f"{actor.silent:.0f} s" if actor.silent >= 0 else "-",
        Text(actor.state if actor.alive else "gone", style="" if actor.alive else "red"),
    ]


def _alive(actors: list[ActorStatus], role: str) -> int:
    return sum(actor.alive and actor.role == role for actor in actors)
