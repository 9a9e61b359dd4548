"""Rewards of both tasks, as pure functions of what one step did."""

from __future__ import annotations

from dataclasses import dataclass

from common.config import RewardConfig
from common.errors import ConfigError


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What one decision led to.

    Attributes:
        distance: travelled metres.
        frontier_removed: length of the frontier that is no frontier any more, metres (cells x resolution).
        progress: straight-line metres that the robot came nearer to the target; 0 without target.
        complete: the task is complete now, and was not before.
        remaining_before: the privileged expert's remaining distance T(s), metres; None when no expert was asked.
        remaining_after: T(s'), metres, 0 when complete; None when no expert was asked.
    """

    distance: float
    frontier_removed: float
    progress: float
    complete: bool
    remaining_before: float | None = None
    remaining_after: float | None = None


def paper_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Reward of the ARiADNE and HDPlanner family: r = r_o + r_d + r_f.

    r_o pays for the removed frontier, r_d charges the travelled distance, r_f is the bonus for finishing; an optional
    term pays for coming nearer to the target in navigation. In the family's released code 50 frontiers on a grid of
    4 px earn 1 and 64 px of travel cost 1: 50 m of frontier and 16 m at 0.25 m/px.
    """
    reward = config.frontier_weight * outcome.frontier_removed / config.frontier_scale
    reward -= config.distance_weight * outcome.distance / config.distance_scale
    reward += config.progress_weight * outcome.progress / config.distance_scale
    return reward + (config.finish_bonus if outcome.complete else 0.0)


def potential_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Privileged reward (T(s) - T(s') - d) / scale: minus the detour that the step caused.

    T is the expert's remaining distance on the true map, so a step of the expert's own route is worth 0. For
    training only.

    Raises:
        ConfigError: no expert was asked.
    """
    if outcome.remaining_before is None or outcome.remaining_after is None:
        raise ConfigError("the potential reward needs the privileged expert's remaining distance before and after")
    detour = outcome.remaining_after + outcome.distance - outcome.remaining_before
    return -detour / config.potential_scale


def step_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Reward of one step, of the configured kind."""
    return paper_reward(config, outcome) if config.kind == "paper" else potential_reward(config, outcome)
