"""Prints what a recording and its replay tell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.console import Console

from common.cli import whole_table
from deploy.recording.bag_player import Playback
from deploy.recording.checks import Checks, histogram
from deploy.recording.comparison import Comparison


def summary(checks: Checks, replayed: Playback | None, comparison: Comparison | None) -> dict[str, Any]:
    """Return everything as plain values, ready for JSON."""
    result: dict[str, Any] = {
        "duration": round(checks.duration, 3),
        "topics": {
            name: {
                "type": check.kind,
                "messages": check.count,
                "invalid": check.invalid,
                "rate": round(check.rate, 3),
                "longest_gap": round(check.gap, 3),
                "frames": sorted(check.frames),
                "notes": check.notes(),
                "values": {label: round(share, 4) for label, share in histogram(check.values)} if check.values else {},
            }
            for name, check in sorted(checks.topics.items())
        },
        "warnings": checks.warnings(),
    }
    if replayed is not None:
        times = replayed.seconds
        result["replay"] = {
            "decisions": len(times),
            "decision_p50": round(float(np.percentile(times, 50)), 4) if times else None,
            "decision_p95": round(float(np.percentile(times, 95)), 4) if times else None,
            "waypoints": sum(one.waypoint is not None for one in replayed.decided),
            "faults": replayed.faults,
            "end": replayed.end[0],
            "reason": replayed.end[1],
            "map": {
                "received": replayed.map_statistics.received,
                "integrated": replayed.map_statistics.integrated,
                "dropped": dict(replayed.map_statistics.dropped),
                "problem": replayed.map_statistics.problem,
            },
        }
    if comparison is not None and comparison.differences:
        distances, first = comparison.distances(), comparison.first
        result["comparison"] = {
            "recorded_waypoints": len(comparison.differences),
            "agreement": round(comparison.agreement, 4),
            "tolerance": comparison.tolerance,
            "distance_p50": round(float(np.percentile(distances, 50)), 3) if distances else None,
            "distance_p95": round(float(np.percentile(distances, 95)), 3) if distances else None,
            "distance_max": round(distances[-1], 3) if distances else None,
            "first_difference": None
            if first is None
            else {
                "time": round(first.time, 2),
                "recorded": first.recorded,
                "replayed": first.replayed,
                "distance": None if math.isinf(first.distance) else round(first.distance, 3),
                "pose": first.pose,
            },
        }
    return result


def show(result: dict[str, Any], console: Console) -> None:
    """Print a summary for people."""
    console.print(f"{result['duration']:.1f} s, {len(result['topics'])} topics")
    table = whole_table("topic", "type", "messages", "Hz", "longest gap", "frames", "notes")
    for name, topic in result["topics"].items():
        table.add_row(
            name,
            topic["type"].split("/")[-1],
            str(topic["messages"]),
            f"{topic['rate']:.1f}",
            f"{topic['longest_gap']:.2f} s",
            ", ".join(topic["frames"]),
            topic["notes"],
        )
    console.print(table)
    for name, topic in result["topics"].items():
        if topic["values"]:
            shares = "  ".join(f"{label}: {100.0 * share:.1f} %" for label, share in topic["values"].items() if share)
            console.print(f"values of {name}: {shares}")
    for warning in result["warnings"]:
        console.print(f"[yellow]warning:[/] {warning}", highlight=False)
    if "replay" in result:
        _show_replay(result["replay"], console)
    if "comparison" in result:
        _show_comparison(result["comparison"], console)
    elif "replay" in result:
        console.print("the recording holds no waypoints to compare with")


def _show_replay(replay: dict[str, Any], console: Console) -> None:
    took = "" if replay["decision_p50"] is None else (
        f" in {1000.0 * replay['decision_p50']:.0f} ms (p50), {1000.0 * replay['decision_p95']:.0f} ms (p95)"
    )  # fmt: skip
    mapped = replay["map"]
    console.print(
        f"replay: {replay['decisions']} decisions{took}, {replay['waypoints']} waypoints; "
        f"ended {replay['end']}: {replay['reason']}"
    )
    dropped = ", ".join(f"{count} {reason}" for reason, count in mapped["dropped"].items()) or "none"
    console.print(
        f"map: {mapped['integrated']} of {mapped['received']} sensor messages went in; dropped: {dropped}"
        + (f"; {mapped['problem']}" if mapped["problem"] else "")
    )
    for kind, passes in replay["faults"].items():
        console.print(f"[yellow]warning:[/] fault {kind} for {passes / 10.0:.1f} s")


def _show_comparison(comparison: dict[str, Any], console: Console) -> None:
    console.print(
        f"agreement: {100.0 * comparison['agreement']:.1f} % of {comparison['recorded_waypoints']} recorded waypoints "
        f"were decided again within {comparison['tolerance']:g} m"
    )
    if comparison["distance_p50"] is not None:
        console.print(
            f"distance between waypoints: {comparison['distance_p50']:.2f} m (p50), "
            f"{comparison['distance_p95']:.2f} m (p95), {comparison['distance_max']:.2f} m at most"
        )
    first = comparison["first_difference"]
    if first is not None:
        instead = "nowhere" if first["replayed"] is None else _place(first["replayed"])
        console.print(
            f"first difference after {first['time']:.1f} s at {_place(first['pose'])}: "
            f"recorded {_place(first['recorded'])}, replayed {instead}"
        )


def _place(position: tuple[float, float] | None) -> str:
    return "an unknown place" if position is None else f"({position[0]:.2f}, {position[1]:.2f})"
