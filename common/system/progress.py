"""How far a long command is: bars on a terminal, now and then a line elsewhere, both with the time left."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self, TypeVar

from common.system.kernel_folders import kernels_are_compiled

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TaskID

T = TypeVar("T")

LINE_SECONDS: Final = 30.0
"""Between two lines where there is no terminal for bars."""


class Steps:
    """Counts steps of named tasks and shows how far they are.

    Usage::

        with Steps(console) as steps:
            steps.add("nearest", total=100)
            for episode in episodes:
                ...
                steps.advance("nearest")

    Args:
        console: where to show it.
        unit: what a step is, in the plural, for the lines.
        clock: monotonic seconds.
    """

    def __init__(self, console: Console, unit: str = "episodes", clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._unit = unit
        self._clock = clock
        self._tasks: dict[str, TaskID] = {}
        # A line follows from what was done since the start: work of an earlier run took none of its time.
        self._before = 0
        self._began = self._said = clock()
        # Not where a command line only wants the name of this class.
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._bars = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Show nothing more; safe to call twice."""
        self._bars.stop()

    def add(self, name: str, total: int, done: int = 0) -> None:
        """Add a task, of whose steps some may be done already."""
        self._tasks[name] = self._bars.add_task(name, total=total, completed=done)
        self._before += done

    def advance(self, name: str) -> None:
        """Count one more step of a task."""
        self._bars.advance(self._tasks[name])
        now = self._clock()
        if not self._console.is_terminal and now - self._said > LINE_SECONDS:
            self._said = now
            self._console.print(self.line(now), markup=False, highlight=False, soft_wrap=True)

    def track(self, name: str, things: Iterable[T], total: int) -> Iterator[T]:
        """Pass things on and count each as a step once the next one is asked for."""
        self.add(name, total)
        for thing in things:
            yield thing
            self.advance(name)

    def line(self, now: float) -> str:
        """Say how far all tasks are, and how long the rest will take at the pace so far."""
        tasks = self._bars.tasks
        counts = ", ".join(f"{task.description} {task.completed:.0f} of {task.total or 0:.0f}" for task in tasks)
        done = sum(task.completed for task in tasks)
        left = sum(task.total or 0 for task in tasks) - done
        made = done - self._before
        if made <= 0 or left <= 0:
            return f"{counts} {self._unit}"
        return f"{counts} {self._unit}, about {duration(left * (now - self._began) / made)} left"


def duration(seconds: float) -> str:
    """Put a time into words: seconds up to two minutes, minutes up to two hours, then hours."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def tell_of_kernels(console: Console, *packages: str) -> None:
    """Say that the first run compiles kernels, where these packages have none compiled yet."""
    if not all(kernels_are_compiled(package) for package in packages):
        console.print("preparing compiled kernels for the first time: a minute or two", highlight=False)
