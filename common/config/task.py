"""The task and its reward."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config.section import Fraction, Positive, Section
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

    kind: Literal["paper", "potential", "approach", "area"] = "paper"
    """`paper`: travelled distance, observed frontiers and a bonus for finishing, as in ARiADNE. `potential`: the
    privileged expert's remaining distance T as a potential, (T(s) - T(s') - d) / scale; for training only. `approach`:
    (T(s) - T(s')) / scale, a cost for each step and a bonus for finishing, as in `ca`; for training only. `area`: newly
    seen floor, and a cost for a step that shows next to none, as in `cnn`."""
    frontier_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the frontier removed by the step, in units of `frontier_scale`."""
    frontier_scale: Positive = 50.0
    """paper: metres of removed frontier that earn `frontier_weight` (default: 50 frontiers on a 1 m grid)."""
    distance_weight: Annotated[float, Field(ge=0.0)] = 1.0
    """paper: weight of the travelled distance, in units of `distance_scale`."""
    distance_scale: Positive = 16.0
    """paper: metres of travel that cost `distance_weight`; approach: metres of T per unit of reward (default: 64 px at
    0.25 m/px)."""
    progress_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """paper: weight of the straight-line progress towards the target, in units of `distance_scale` (navigation)."""
    finish_bonus: Annotated[float, Field(ge=0.0)] = 20.0
    """paper, approach: added when the task is complete."""
    potential_scale: Positive = 4.0
    """potential: metres per unit of reward."""
    step_cost: Annotated[float, Field(ge=0.0)] = 0.5
    """approach: subtracted at every step."""
    area_scale: Positive = 875.0
    """area: square metres of newly seen floor that earn 1, the most of a step (default: 14,000 px at 0.25 m/px)."""
    least_gain: Fraction = 0.015
    """area: a step that earns no more than this shows next to nothing."""
    idle_cost: Annotated[float, Field(ge=0.0)] = 0.8
    """area: what such a step costs instead."""

    @property
    def privileged(self) -> bool:
        """Whether it takes the expert's remaining distance, which is known in simulation only."""
        return self.kind in ("potential", "approach")
