"""The task and its reward."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Positive, Section
from common.tasks import EXPLORATION, Task, find_task


class TaskConfig(Section):
    """What the robot must do, and when an episode ends."""

    name: str = EXPLORATION.name
    """`exploration`: map everything reachable. `navigation`: reach the target. Or the name of a task from an installed
    package, or MODULE:NAME."""
    max_steps: Annotated[int, Field(ge=1, le=10_000)] = 128
    """Decisions per episode; reaching the limit truncates the episode, it is not a terminal state."""
    unseen_area: Annotated[float, Field(ge=0.0)] = 15.625
    """Exploration is complete when at most this much reachable free area is unseen, m² (the default is 250 px of 0.25
    m)."""
    arrival_radius: Positive = 1.6
    """Navigation is complete within this distance of the target, metres, or on its marker in the map."""

    @property
    def kind(self) -> Task:
        """The task itself; ConfigError when there is none of that name."""
        return find_task(self.name)


class RewardConfig(Section):
    """The reward of both tasks."""

    kind: Literal["paper", "potential"] = "paper"
    """`paper`: travelled distance, observed frontiers and a bonus for finishing. `potential`: the privileged expert's
    remaining distance T as a potential, (T(s) - T(s') - d) / scale; for training only."""
    frontier_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the frontier removed by the step, in units of `frontier_scale`."""
    frontier_scale: Positive = 50.0
    """paper: metres of removed frontier that earn `frontier_weight` (default: 50 frontiers on a 1 m grid)."""
    distance_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the travelled distance, in units of `distance_scale`."""
    distance_scale: Positive = 16.0
    """paper: metres of travel that cost `distance_weight` (default: 64 px at 0.25 m/px)."""
    progress_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """paper: weight of the straight-line progress towards the target, in units of `distance_scale` (navigation)."""
    finish_bonus: Annotated[float, Field(ge=0.0)] = 20.0
    """paper: added when the task is complete."""
    potential_scale: Positive = 4.0
    """potential: metres per unit of reward."""
