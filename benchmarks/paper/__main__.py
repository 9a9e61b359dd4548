"""Make the paper's tables: ``python -m benchmarks.paper --maps MAPS``; the same command continues what was broken off.

MAPS holds the public maps: exploration/{train,bench}, navigation/{train,bench} and cmu/indoor.png (`hd-eval maps` tells
how to fetch them). Results and policies are kept in release/paper, where `hd-eval table release/paper/exploration`
shows them; what is under way is in build/paper. docs/paper.md is brought up to date after each step.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed, wait
from pathlib import Path
from typing import Final

from rich.console import Console

from benchmarks.paper.page import write_page
from benchmarks.paper.plan import TABLES, Place, Training, work
from benchmarks.paper.scenes import make_scenes
from benchmarks.paper.steps import Folders, Steps
from common.cli import message_console
from common.errors import HDError
from common.system.signals import stopping_signals

ROOT: Final = Path(__file__).parents[2]


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what is not done yet; return 1 where a step failed, 130 where all was stopped."""
    options = _parser().parse_args(arguments)
    folders = Folders(options.maps.resolve(), options.work.resolve(), options.release.resolve())
    console = message_console()
    if options.page_only:
        write_page(folders)
        return 0
    steps = Steps(folders)
    failed = 0
    try:
        make_scenes(folders.maps, folders.work / "scenes")
        planned = [
            (training, places)
            for training, chosen in work()
            if (places := [place for place in chosen if place.table.name in options.tables])
            and (training is None or options.train)
        ]
        left = [(training, places) for training, places in planned if not folders.done(training, places)]
        done = len(planned) - len(left)
        if done:
            _say(console, f"{done} of {len(planned)} were done before")
            write_page(folders)
        with stopping_signals(steps.stop, steps.stopped.is_set), ThreadPoolExecutor(options.jobs) as pool:
            chains = [pool.submit(_do, steps, training, places) for training, places in left]
            # Curves come last, because tables matter more where time is short.
            under_way = {each[0]: chain for each, chain in zip(left, chains, strict=True)}
            curves = [
                training
                for training, _ in planned
                if training is not None and (training in under_way or folders.points_left(*training))
            ]
            chains += [pool.submit(_draw, steps, each, under_way.get(each)) for each in curves]
            for number, chain in enumerate(as_completed(chains), done + 1):
                try:
                    names = chain.result()
                except HDError as error:
                    failed += 1
                    _say(console, str(error))
                    continue
                _say(console, f"{number} of {done + len(chains)}: {names}")
                write_page(folders)
    except HDError as error:
        _say(console, str(error))
        return 1
    return 130 if steps.stopped.is_set() else int(failed > 0)


def _do(steps: Steps, training: tuple[Training, int] | None, places: Sequence[Place]) -> str:
    """Train where that is needed, then run the rows; return what was done."""
    if training is not None:
        steps.train(*training)
    for place in places:
        steps.evaluate(place)
    return ", ".join(f"{place.table.name}/{place.row.label}" for place in places)


def _draw(steps: Steps, training: tuple[Training, int], under_way: Future[str] | None) -> str:
    """Draw the learning curve of a training, once that is no longer under way; return what was done."""
    if under_way is not None:
        wait([under_way])
    steps.draw_curve(*training)
    return f"the curve of {training[0].name}-{training[1]}"


def _say(console: Console, line: str) -> None:
    console.print(line, markup=False, highlight=False, soft_wrap=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.paper", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--maps", type=Path, required=True, metavar="MAPS", help="folder of the public maps")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "paper", metavar="DIR", help="what is under way")
    parser.add_argument(
        "--release", type=Path, default=ROOT / "release" / "paper", metavar="DIR", help="what is kept and shown"
    )
    names = [table.name for table in TABLES]
    parser.add_argument(
        "--tables", nargs="+", choices=names, default=names, metavar="TABLE", help=f"of {', '.join(names)}"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="steps at once, a core each (default: 2)")
    parser.add_argument("--no-train", dest="train", action="store_false", help="only rows that need no training")
    parser.add_argument("--page-only", action="store_true", help="only bring docs/paper.md up to date")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
