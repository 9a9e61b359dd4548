"""What the environment returns for each decision."""

from __future__ import annotations

from dataclasses import dataclass

from common.messages.experience import End
from common.observations.observation import Observation


@dataclass(frozen=True, slots=True)
class StepInfo:
    """What else is to be told about a step.

    Attributes:
        reason: why the episode ended, one of `complete`, `step limit`, `nothing useful left`, `target unreachable`,
            `stuck`, `blocked`; empty while the episode runs.
        complete: the task is complete.
        explored: share of the reachable free area that was seen, 0 to 1.
        blocked: the robot did not reach the waypoint.
        collisions: contacts with the world that began on this step.
    """

    reason: str
    complete: bool
    explored: float
    blocked: bool
    collisions: int


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The result of one decision.

    Attributes:
        observation: what the robot knows now. After a terminal end it may offer no choices; when the robot is stuck
            it repeats the last one.
        reward: reward of the decision.
        end: whether and how the episode ended.
        distance: travelled metres of this step.
        info: what else is to be told.
    """

    observation: Observation
    reward: float
    end: End
    distance: float
    info: StepInfo
