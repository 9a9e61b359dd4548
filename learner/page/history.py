"""What a run's folder tells of the time before its page was opened; of a run elsewhere nothing is known of it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from google.protobuf.message import DecodeError
from tensorboard.compat.proto.event_pb2 import Event, SessionLog

from learner.page.curves import Point
from learner.run.episodes import read_episodes
from learner.run.event_file import PATTERN, read_events

log = logging.getLogger(__name__)

SHOWN: Final = ("loss/", "entropy/", "temperature/", "value/", "gradient/", "cloning/", "policy/", "advantage/")
"""Beginnings of the tags of what an algorithm reports."""
GROUPS: Final = ("episode_train/", "episode_evaluate/", "evaluation/")
_LONE: Final = ("time/updates_per_second", "collect/steps_per_second", "ratio/actual", "replay/fill")
_LARGEST_FILE: Final = 256 << 20


def read_points(folder: Path) -> list[Point]:
    """Return the points of the curves in a run's folder, in order; empty where there are none.

    What was trained again after a resume counts once, as in TensorBoard.
    """
    points: list[Point] = []
    for path in sorted((folder / "tensorboard").glob(PATTERN)):
        try:
            for event in _events(path):
                if event.HasField("session_log") and event.session_log.status == SessionLog.START:
                    points = [point for point in points if point.updates < event.step]
                values = {each.tag: each.simple_value for each in event.summary.value if is_shown(each.tag)}
                if values:
                    points.append(Point(event.wall_time, event.step, values))
        except (OSError, DecodeError) as error:
            log.warning("the curves in %s cannot be shown: %s", path, error)
    return points


def read_evaluations(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of `episodes.jsonl` that tell of evaluations, oldest first."""
    path = folder / "episodes.jsonl"
    if path.is_file():
        for values, report in read_episodes(path):
            if report.role == "evaluate":
                yield values


def is_shown(tag: str) -> bool:
    """Whether the page has a curve of this figure."""
    return tag in _LONE or tag.startswith((*SHOWN, *GROUPS))


def _events(path: Path) -> Iterator[Event]:
    """Yield the events of a file; of a very large one none, and say so."""
    if path.stat().st_size > _LARGEST_FILE:
        log.warning("%s is larger than %d MB: its curves are not shown", path, _LARGEST_FILE >> 20)
        return
    yield from read_events(path.read_bytes())
