"""Writing benchmark figures into a policy's card."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from actors.evaluation.omniscient import NAME as OMNISCIENT
from actors.evaluation.results import Results, ResultsError
from actors.evaluation.statistics import distance_ratio, find, summarise
from common.policies.policy_file import PolicyCard, read_card, write_card


def note_bench(policy: Path, found: Sequence[Results], planner: str) -> PolicyCard:
    """Write a policy's benchmark figures, along with those of the other planners, into its card.

    Args:
        policy: the weights; the card lies beside them.
        found: results of the policy and of the planners to compare with.
        planner: name of the policy in its results.

    Raises:
        CheckpointError: the card cannot be read or written.
        ResultsError: there are no results of that planner, or they are of another task.
    """
    card = read_card(policy)
    own = find(found, planner)
    if own.task not in card.tasks:
        raise ResultsError(f"the policy is for {card.task}, the results are of {own.task}: choose results of its task")
    bench = {}
    for results in found:
        summary = summarise(results)
        figures = {
            "maps": float(summary.episodes),
            "distance_m": round(summary.mean, 2),
            "success": round(summary.success, 4),
            "decision_ms": round(summary.median_ms, 2),
        }
        if results.planner != planner:
            figures["ratio"] = round(distance_ratio(own, results), 4)
        bench[results.planner] = figures
    if OMNISCIENT in bench:
        bench[OMNISCIENT].pop("decision_ms")
    card = replace(card, bench=bench)
    write_card(policy, card)
    return card
