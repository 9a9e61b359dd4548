"""Bring docs/benchmarks.md up to date: ``python -m benchmarks.planners RESULTS --maps MAPS``.

RESULTS holds what ``hd-eval run --out`` wrote, in the folders ``exploration`` and ``navigation``; MAPS the maps, in
``exploration/bench`` and ``navigation/bench``. The tables on the page, between comments that say so, and the pictures
beside it are made anew from these files alone; the words are left as they are, and have to be read again.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from actors.evaluation import plots
from actors.evaluation.resolving import settings_of
from actors.evaluation.results import Results, collect_results
from actors.evaluation.table import make_rows, notes, render
from benchmarks.blocks import with_block

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
PICTURES = "pictures/benchmarks"
BASELINES = {"exploration": "tare", "navigation": "dstar_lite"}
# Who is in the pictures of one map, when there are results: more would be too small to see.
SHOWN = {
    "exploration": ("omniscient", "greedy", "tare", "dsvp", "hdplanner"),
    "navigation": ("omniscient", "dstar_lite", "far", "bit_star", "hdplanner"),
}


def table_of(found: Sequence[Results], baseline: str | None) -> str:
    """Return results as Markdown: what each planner did, how they compare with one, and what a reader has to know."""
    titles, rows = make_rows(found, baseline, "px")
    cut = next((number for number, title in enumerate(titles) if title.startswith("/ ")), len(titles))
    halves = [range(cut), [0, *range(cut, len(titles))]][: 1 if baseline is None else 2]
    tables = [
        render([titles[place] for place in half], [[row[place] for place in half] for row in rows], "markdown").strip()
        for half in halves
    ]
    return "\n\n".join([*tables, "\n".join(f"- {note}" for note in notes(found, baseline))])


def typical_map(found: Sequence[Results]) -> str:
    """Return the map whose distance, in the mean over the planners, is the median one: neither easy nor hard."""
    shared = set.intersection(*({episode.map for episode in results.episodes} for results in found))
    distances = [{episode.map: episode.distance_m for episode in results.episodes} for results in found]
    means = {name: float(np.mean([one[name] for one in distances])) for name in sorted(shared)}
    return sorted(means, key=means.__getitem__)[len(means) // 2]


def main() -> None:
    """Make tables and pictures of all tasks that have results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, metavar="RESULTS")
    parser.add_argument("--maps", type=Path, required=True, metavar="MAPS")
    arguments = parser.parse_args()
    page = PAGE.read_text("utf-8")
    for task, baseline in BASELINES.items():
        folder = arguments.results / task
        if not folder.is_dir():
            continue
        found = collect_results([folder])
        # The shortest first, planners that failed on maps by their distance so far.
        found.sort(key=lambda results: float(np.mean([episode.distance_m for episode in results.episodes])))
        page = with_block(page, f"<!-- table of {task}: made by benchmarks.planners -->", table_of(found, baseline))
        picture = PAGE.parent / PICTURES
        plots.plot_boxes(found, picture.with_name(f"{picture.name}-{task}-boxes.png"))
        plots.plot_scatter(found, baseline, picture.with_name(f"{picture.name}-{task}-scatter.png"))
        shown = [results for results in found if results.planner in SHOWN[task]]
        settings, worlds = settings_of(found[0], [str(arguments.maps / task / "bench")], None, None, None)
        name = typical_map(shown)
        world = worlds.load(worlds.find([name])[name])
        plots.plot_trajectories(shown, name, world, settings, picture.with_name(f"{picture.name}-{task}-routes.png"))
    PAGE.write_text(page, "utf-8")


if __name__ == "__main__":
    main()
