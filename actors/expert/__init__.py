"""Privileged experts: they see the true map, so they serve training only."""

from __future__ import annotations

from typing import cast

from actors.expert.base import Expert, ExpertLabel
from actors.expert.exploration import ExplorationExpert
from actors.expert.navigation import NavigationExpert
from common.config import MappingConfig, TaskConfig

__all__ = ["Expert", "ExpertLabel", "ExplorationExpert", "NavigationExpert", "make_expert"]


def make_expert(task: TaskConfig, mapping: MappingConfig) -> Expert:
    """Return the expert of a task; ConfigError when it has none."""
    return cast(Expert, task.kind.part("expert")(task, mapping))
