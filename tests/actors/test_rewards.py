import pytest

from actors.rewards import StepOutcome, step_reward
from common.config import RewardConfig
from common.errors import ConfigError


def outcome(**changes):
    values = {"distance": 8.0, "frontier_removed": 25.0, "progress": 0.0, "newly_seen": 0.0, "complete": False}
    return StepOutcome(**{**values, **changes})


def test_the_paper_reward_by_hand():
    # 25 m of frontier earn 25 / 50, 8 m of travel cost 8 / 16.
    assert step_reward(RewardConfig(), outcome()) == pytest.approx(0.0)
    assert step_reward(RewardConfig(), outcome(distance=4.0)) == pytest.approx(0.25)


def test_the_family_counts_pixels():
    # ARiADNE's code: 50 frontiers on a 4 px grid earn 1, 64 px cost 1; at 0.25 m/px these are 50 m and 16 m.
    assert step_reward(RewardConfig(), outcome(distance=16.0, frontier_removed=0.0)) == pytest.approx(-1.0)
    assert step_reward(RewardConfig(), outcome(distance=0.0, frontier_removed=50.0)) == pytest.approx(1.0)


def test_finishing_earns_the_bonus():
    assert step_reward(RewardConfig(finish_bonus=20.0), outcome(complete=True)) == pytest.approx(20.0)


def test_progress_counts_when_weighted():
    config = RewardConfig(progress_weight=1.0)
    assert step_reward(config, outcome(frontier_removed=0.0, progress=8.0)) == pytest.approx(0.0)
    assert step_reward(config, outcome(frontier_removed=0.0, progress=-8.0)) == pytest.approx(-1.0)


def test_the_potential_reward_is_minus_the_detour():
    config = RewardConfig(kind="potential", potential_scale=4.0)
    on_route = outcome(distance=8.0, remaining_before=100.0, remaining_after=92.0)
    detour = outcome(distance=8.0, remaining_before=100.0, remaining_after=104.0)
    finished = outcome(distance=8.0, remaining_before=8.0, remaining_after=0.0, complete=True)
    assert step_reward(config, on_route) == pytest.approx(0.0)
    assert step_reward(config, detour) == pytest.approx(-3.0)
    assert step_reward(config, finished) == pytest.approx(0.0)


@pytest.mark.parametrize("kind", ["potential", "approach"])
def test_privileged_rewards_need_an_expert(kind):
    assert RewardConfig(kind=kind).privileged
    with pytest.raises(ConfigError, match="expert"):
        step_reward(RewardConfig(kind=kind), outcome())


def test_coming_nearer_on_the_true_map_counts_in_context_aware_navigation():
    # Its code: 0.5 a step, 64 px (16 m) nearer earn 1, the target 20.
    config = RewardConfig(kind="approach")
    assert step_reward(config, outcome(remaining_before=100.0, remaining_after=92.0)) == pytest.approx(0.0)
    assert step_reward(config, outcome(remaining_before=92.0, remaining_after=100.0)) == pytest.approx(-1.0)
    arrived = outcome(remaining_before=8.0, remaining_after=0.0, complete=True)
    assert step_reward(config, arrived) == pytest.approx(20.0)


def test_newly_seen_floor_counts_for_the_network_over_images():
    # Its code: 14,000 px (875 m2) earn 1 at most, a step that shows 0.015 of that or less costs 0.8.
    config = RewardConfig(kind="area")
    assert step_reward(config, outcome(newly_seen=437.5)) == pytest.approx(0.5)
    assert step_reward(config, outcome(newly_seen=2000.0)) == pytest.approx(1.0)
    assert step_reward(config, outcome(newly_seen=0.015 * 875.0)) == pytest.approx(-0.8)
    assert step_reward(config, outcome(newly_seen=0.016 * 875.0)) == pytest.approx(0.016)
