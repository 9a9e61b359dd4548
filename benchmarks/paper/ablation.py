"""The ablation: what the parts of the method are worth, each against all of them together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from actors.evaluation.results import Results
from actors.evaluation.statistics import compare, distance_ratio
from actors.evaluation.table import render
from benchmarks.paper.claims import Found
from benchmarks.paper.seeds import mean_of_seeds, same_planner

WHOLE: Final = "hdplanner"
PARTS: Final = {
    WHOLE: "everything",
    "hierarchical": "without the contrastive loss",
    "vanilla": "without beacons",
    "paper-features": "with the paper's five node features only",
    "full-graph": "reading every viewpoint instead of the reduced graph",
}
"""What each variant lacks, by label."""


def ablation(found: Found) -> str:
    """Return the ablation as Markdown: of each variant its seeds, and its travel over that of everything together."""
    cells = []
    for task in ("exploration", "navigation"):
        results = found.get(task, ())
        whole = mean_of_seeds(results, WHOLE)
        if whole is not None:
            cells += [row for label, lacks in PARTS.items() if (row := _row(task, label, lacks, results, whole))]
    titles = ["task", "variant", "", "seeds", f"travel / {WHOLE}", "95 % interval", "t-test p", "each seed"]
    return render(titles, cells, "markdown").strip() if cells else ""


def _row(task: str, label: str, lacks: str, results: Sequence[Results], whole: Results) -> list[str]:
    """Return the cells of a variant, none where no seed of it is done."""
    seeds, mean = same_planner(results, label), mean_of_seeds(results, label)
    if mean is None:
        return []
    each = ", ".join(f"{distance_ratio(one, whole):.3f}" for one in seeds)
    start = [task, label, lacks, str(len(seeds))]
    if label == WHOLE:
        return [*start, "1", "", "", each]
    against = compare(mean, whole)
    return [*start, f"{against.ratio:.3f}", f"{against.low:.3f} to {against.high:.3f}", f"{against.t_p:.2g}", each]
