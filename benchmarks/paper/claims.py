"""The paper's claims, one by one: its figure, ours, and whether the claim holds here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from actors.evaluation.results import Results
from actors.evaluation.statistics import Summary, compare, summarise
from benchmarks.paper.plan import SEEDS
from benchmarks.paper.seeds import mean_of_seeds, same_planner, seeds_done

Found = Mapping[str, Sequence[Results]]
"""The results of each table, those of all its rows that are done."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What came out.

    Attributes:
        figure: measured here; empty where nothing was.
        words: holds, does not hold, not decided, or why it cannot be compared.
    """

    figure: str
    words: str


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper about figures of a table.

    Attributes:
        where: what it is about.
        statement: in a few words.
        published: the paper's figure.
        judge: makes the verdict from the results of all tables.
    """

    where: str
    statement: str
    published: str
    judge: Callable[[Found], Verdict]


def drives(table: str, planner: str, baseline: str, published: float) -> Callable[[Found], Verdict]:
    """Return the judge of a ratio of distances: on the paper's side of 1, with its whole 95 % interval, holds.

    Args:
        table: name.
        planner: label; of a trained one without its seed, whose distances are the means over the seeds that are done.
        baseline: label of the one that it is compared with, likewise.
        published: ratio in the paper; which side of 1 it lies on is the claim.
    """

    def judge(found: Found) -> Verdict:
        here, there = (mean_of_seeds(found.get(table, ()), label) for label in (planner, baseline))
        missing = [label for label, results in ((planner, here), (baseline, there)) if results is None]
        if here is None or there is None:
            return Verdict("", f"not finished: {' and '.join(missing)}")
        against = compare(here, there)
        figure = f"{against.ratio:.3f} ({against.low:.3f} to {against.high:.3f}; p {against.t_p:.2g})"
        if against.low <= 1.0 <= against.high:
            words = "not decided: the interval holds 1"
        else:
            words = "holds" if (against.ratio < 1.0) == (published < 1.0) else "does not hold"
        # Of two that are trained the one with fewer seeds decides how much the ratio says.
        done = [seeds for label in (planner, baseline) if (seeds := seeds_done(found.get(table, ()), label))]
        fewest = min(done, default=len(SEEDS))
        return Verdict(figure, words + (f" ({fewest} of {len(SEEDS)} seeds)" if fewest < len(SEEDS) else ""))

    return judge


def succeeds(table: str, planner: str, published: float) -> Callable[[Found], Verdict]:
    """Return the judge of a success rate: at least the published share holds."""
    return _figure(
        table,
        planner,
        lambda each: each.success,
        lambda share: f"{100 * share:.1f} %",
        lambda share: share >= published,
    )


def decides(table: str, planner: str, published: float) -> Callable[[Found], Verdict]:
    """Return the judge of the time of a decision: at most the published seconds holds."""
    return _figure(
        table,
        planner,
        lambda each: each.median_ms / 1e3,
        lambda seconds: f"{seconds:.4f} s",
        lambda seconds: seconds <= published,
    )


def _figure(
    table: str,
    planner: str,
    measure: Callable[[Summary], float],
    show: Callable[[float], str],
    holds: Callable[[float], bool],
) -> Callable[[Found], Verdict]:
    """Return the judge of one figure of a planner, the mean over the seeds that are done."""

    def judge(found: Found) -> Verdict:
        same = same_planner(found.get(table, ()), planner)
        if not same:
            return Verdict("", f"not finished: {planner}")
        figure = float(np.mean([measure(summarise(results)) for results in same]))
        return Verdict(show(figure), "holds" if holds(figure) else "does not hold")

    return judge


def beyond(words: str) -> Callable[[Found], Verdict]:
    """Return the judge of what cannot be compared, with the reason."""

    def judge(found: Found) -> Verdict:
        del found
        return Verdict("", f"cannot be compared: {words}")

    return judge


CLAIMS: Final = (
    *(
        Claim(
            "exploration, test maps", f"{name} over TARE", f"{ratio:.3f}", drives("exploration", label, "tare", ratio)
        )
        for name, label, ratio in (
            ("CNN", "cnn", 1.056),
            ("ARiADNE", "ariadne", 0.972),
            ("vanilla", "vanilla", 0.977),
            ("hierarchical", "hierarchical", 0.944),
            ("HDPlanner", "hdplanner", 0.899),
            ("shipped weights", "shipped", 0.899),
        )
    ),
    Claim(
        "exploration, ablation",
        "hierarchical drives less than vanilla",
        "0.966",
        drives("exploration", "hierarchical", "vanilla", 0.966),
    ),
    Claim(
        "exploration, ablation",
        "the contrastive loss helps: HDPlanner drives less than hierarchical",
        "0.952",
        drives("exploration", "hdplanner", "hierarchical", 0.952),
    ),
    Claim(
        "exploration, ablation",
        "both together: HDPlanner drives less than vanilla",
        "0.920",
        drives("exploration", "hdplanner", "vanilla", 0.920),
    ),
    *(
        Claim(
            "navigation, test maps",
            f"{name} over D* Lite",
            f"{ratio:.3f}",
            drives("navigation", label, "dstar_lite", ratio),
        )
        for name, label, ratio in (
            ("BIT*", "bit_star", 1.263),
            ("CA", "ca", 1.076),
            ("vanilla", "vanilla", 1.131),
            ("hierarchical", "hierarchical", 1.042),
            ("HDPlanner", "hdplanner", 0.997),
            ("shipped weights", "shipped", 0.997),
        )
    ),
    Claim("navigation, test maps", "BIT* arrives", "88.7 %", succeeds("navigation", "bit_star", 0.887)),
    Claim("navigation, test maps", "CA arrives", "99.3 %", succeeds("navigation", "ca", 0.993)),
    Claim("navigation, test maps", "shipped weights arrive", "100 %", succeeds("navigation", "shipped", 1.0)),
    Claim("large scene, exploring", "DSVP over TARE", "1.222", drives("large-exploration", "dsvp", "tare", 1.222)),
    Claim(
        "large scene, exploring",
        "HDPlanner over TARE",
        "0.786",
        drives("large-exploration", "hdplanner", "tare", 0.786),
    ),
    Claim(
        "large scene, exploring",
        "shipped weights over TARE",
        "0.786",
        drives("large-exploration", "shipped", "tare", 0.786),
    ),
    Claim(
        "large scene, exploring",
        "travel up to 35.7 % shorter: shipped weights over DSVP",
        "0.643",
        drives("large-exploration", "shipped", "dsvp", 0.643),
    ),
    Claim(
        "large scene, exploring", "ARiADNE over TARE", "0.776", drives("large-exploration", "ariadne", "tare", 0.776)
    ),
    Claim(
        "large scene, navigating",
        "travel up to 16.5 % shorter: shipped weights over D* Lite",
        "0.835",
        drives("large-navigation", "shipped", "dstar_lite", 0.835),
    ),
    *(
        Claim(where, f"{name}: a decision", f"{seconds:g} s", decides(table, label, seconds))
        for where, name, table, label, seconds in (
            ("large scene, computing", "shipped weights", "large-exploration", "shipped", 0.24),
            ("large scene, computing", "TARE", "large-exploration", "tare", 0.25),
            ("large scene, computing", "DSVP", "large-exploration", "dsvp", 0.98),
            ("large scene, computing", "FAR", "large-navigation", "far", 0.41),
            ("large scene, computing", "D* Lite", "large-navigation", "dstar_lite", 1.10),
        )
    ),
    Claim(
        "hardware",
        "runs on a real robot without further training",
        "shown",
        beyond("no robot here; the simulated one drives over the same bus (tables below)"),
    ),
)
