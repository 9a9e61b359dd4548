"""Rewards of both tasks and of the learned baselines, as pure functions of what one step did."""

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
        newly_seen: area that has become known to be free, square metres.
        complete: the task is complete now, and was not before.
        remaining_before: the privileged expert's remaining distance T(s), metres; None when no expert was asked.
        remaining_after: T(s'), metres, 0 when complete; None when no expert was asked.
    """

    distance: float
    frontier_removed: float
    progress: float
    newly_seen: float
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


def approach_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Privileged reward of context-aware navigation: (T(s) - T(s')) / scale, a cost for each step, and the bonus.

    T is the shortest way to the target on the true map. In the released code of Liang et al. (CoRL 2023) a step costs
    0.5, 64 px nearer earn 1, and the target 20.

    Raises:
        ConfigError: no expert was asked.
    """
    if outcome.remaining_before is None or outcome.remaining_after is None:
        raise ConfigError("the approach reward needs the privileged expert's remaining distance before and after")
    reward = (outcome.remaining_before - outcome.remaining_after) / config.distance_scale - config.step_cost
    return reward + (config.finish_bonus if outcome.complete else 0.0)


def area_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Reward of Chen et al. (2019): newly seen floor up to 1, and a fixed cost for a step that shows next to none.

    In their released code 14,000 px earn 1, and a step that earns 0.015 or less costs 0.8 instead. A collision costs 1
    there; viewpoints of the graph cannot be driven to through obstacles.
    """
    gain = min(outcome.newly_seen / config.area_scale, 1.0)
    return gain if gain > config.least_gain else -config.idle_cost


_REWARDS = {
    "paper": paper_reward,
    "potential": potential_reward,
    "approach": approach_reward,
    "area": area_reward,
}


def step_reward(config: RewardConfig, outcome: StepOutcome) -> float:
    """Reward of one step, of the configured kind."""
    return _REWARDS[config.kind](config, outcome)
