"""Shows how far an evaluation is, for the commands that run one."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from common.signals import on_signals

if TYPE_CHECKING:
    from actors.evaluation.runner import Evaluation
    from actors.evaluation.runner import Progress as Finished

# Seconds between two lines about progress where there is no terminal for bars.
LINE_SECONDS = 30.0


def planner_list(given: Sequence[str]) -> list[str]:
    """Return the names in options that may hold several each, with commas between them."""
    return [name for text in given for name in text.split(",") if name]


def run_and_show(evaluation: Evaluation, planners: Sequence[str], jobs: int, console: Console) -> bool:
    """Run all episodes that are missing, with a bar for each planner; return whether episodes crashed.

    Args:
        evaluation: what is to be run.
        planners: names of its planners.
        jobs: processes; 0 for one per core.
        console: where to show it.

    Raises:
        HDError: the processes cannot start, or the results cannot be written.
        KeyboardInterrupt: on SIGINT or SIGTERM; the results hold what was done, and the console was told how to go on.
    """
    bars = progress_bars(console)
    with bars, termination_interrupts():
        rows = {
            name: bars.add_task(name, total=evaluation.worlds, completed=evaluation.done(name))
            for name in dict.fromkeys(planners)
        }
        said = time.monotonic()

        def watch(finished: Finished) -> None:
            nonlocal said
            bars.advance(rows[finished.job.planner])
            if not console.is_terminal and time.monotonic() - said > LINE_SECONDS:
                said = time.monotonic()
                counts = ", ".join(f"{task.description} {task.completed:.0f}" for task in bars.tasks)
                console.print(f"{counts} of {evaluation.worlds} episodes", highlight=False)

        try:
            evaluation.run(jobs, watch)
        except KeyboardInterrupt:
            bars.stop()
            for name in rows:
                file, done = evaluation.results_file(name), evaluation.done(name)
                console.print(f"{file}: {done} of {evaluation.worlds} episodes", highlight=False)
            console.print("broken off: the same command goes on from here", highlight=False)
            raise
    crashes = evaluation.crashes()
    for name in rows:
        console.print(f"{evaluation.results_file(name)}: {evaluation.done(name)} episodes", highlight=False)
    for name, found in evaluation.incomplete().items():
        map_name, outcome = max(found, key=lambda entry: entry[1].unseen)
        console.print(
            f"[bold yellow]{name}: {len(found)} explorations ended incomplete[/], the most is left on {map_name}:",
            highlight=False,
        )
        console.print(f"  {outcome.reason}", markup=False, highlight=False)
    for name, found in crashes.items():
        first, outcome = found[0]
        console.print(f"[bold red]{name}: {len(found)} episodes crashed[/], the first on {first}:", highlight=False)
        console.print(f"  {outcome.reason}", markup=False, highlight=False)
    return bool(crashes)


@contextmanager
def termination_interrupts() -> Iterator[None]:
    """Let the first SIGTERM raise a KeyboardInterrupt within the `with`; later ones do not disturb what it causes."""
    told = False

    def interrupt(number: signal.Signals) -> None:
        nonlocal told
        del number
        if not told:
            told = True
            raise KeyboardInterrupt

    with on_signals(interrupt, signal.SIGTERM):
        yield


def progress_bars(console: Console) -> Progress:
    """Return progress bars, which show nothing when the console is no terminal."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    )
