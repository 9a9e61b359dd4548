"""The progress display of commands that run an evaluation."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from common.system.progress import Steps, tell_of_kernels
from common.system.remote_files import RemoteFolder
from common.system.signals import on_signals

if TYPE_CHECKING:
    from rich.console import Console

    from actors.evaluation.runner import Evaluation
    from actors.evaluation.runner import Progress as Finished


def planner_list(given: Sequence[str]) -> list[str]:
    """Return the names in options that may hold several each, with commas between them."""
    return [name for text in given for name in text.split(",") if name]


def run_and_show(
    evaluation: Evaluation,
    planners: Sequence[str],
    jobs: int,
    console: Console,
    copy_to: str | None,
    *,
    warn_of_limit: bool = False,
) -> bool:
    """Run all episodes that are missing, with a bar for each planner; return whether episodes crashed.

    Args:
        evaluation: what is to be run.
        planners: names of its planners.
        jobs: processes; 0 for one per core.
        console: where to show it.
        copy_to: URL of a folder to which the results files are copied when all is done, None for none.
        warn_of_limit: say where the step limit is too small for what there is to explore.

    Raises:
        HDError: the processes cannot start, or the results cannot be written or copied.
        KeyboardInterrupt: on SIGINT or SIGTERM; the results hold what was done, and the console said how to continue.
    """
    from rich.markup import escape

    tell_of_kernels(console, "common", "actors")
    rows = list(dict.fromkeys(planners))
    # A wrong URL is said before the work.
    copies = None if copy_to is None else RemoteFolder(copy_to)
    with Steps(console) as steps, termination_interrupts():
        for name in rows:
            steps.add(name, evaluation.worlds, evaluation.done(name))

        def watch(finished: Finished) -> None:
            steps.advance(finished.job.planner)

        def warn(sentence: str) -> None:
            console.print("[bold yellow]warning:[/]", escape(sentence), emoji=False, highlight=False, soft_wrap=True)

        changed = evaluation.maps_warning()
        if changed:
            warn(changed)
        try:
            evaluation.run(jobs, watch, warn if warn_of_limit else None)
        except KeyboardInterrupt:
            steps.stop()
            for name in rows:
                file, done = evaluation.results_file(name), evaluation.done(name)
                console.print(f"{file}: {done} of {evaluation.worlds} episodes", highlight=False)
            console.print("interrupted: the same command continues from here", highlight=False)
            raise
    crashes = evaluation.crashes()
    for name in rows:
        file = evaluation.results_file(name)
        console.print(f"{file}: {evaluation.done(name)} episodes", highlight=False)
        if copies is not None:
            copies.put(file, file.name)
            console.print(f"{copies.url}/{file.name}", highlight=False)
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
