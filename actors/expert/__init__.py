"""Privileged experts: they see the true map, so they serve training only."""

from __future__ import annotations

from typing import cast

from actors.expert.base import Expert, ExpertLabel
from actors.expert.exploration import ExplorationExpert
from actors.expert.hints import HintingExpert
from actors.expert.navigation import NavigationExpert
from common.config import MappingConfig, TaskConfig

__all__ = ["Expert", "ExpertLabel", "ExplorationExpert", "HintingExpert", "NavigationExpert", "make_expert"]


def make_expert(task: TaskConfig, mapping: MappingConfig, *, hints: bool = False) -> Expert:
    """Return the expert of a task, whose labels hold ``hints`` or do not; ConfigError when the task has none."""
    expert = cast(Expert, task.kind.part("expert")(task, mapping))
    return HintingExpert(expert, mapping) if hints else expert
