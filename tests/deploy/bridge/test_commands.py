"""What a command may say, whoever sends it."""

import pytest

from deploy.bridge.commands import Commands
from deploy.bridge.mission import Mission, Phase
from deploy.bridge.words import CommandError


class Gate:
    def __init__(self):
        self.latched = ""

    def emergency_stop(self, reason):
        self.latched = reason

    def release(self):
        self.latched = ""


def robot_at(x=0.0, y=0.0, *, moving=True):
    """The mission and the commands of a robot that navigates."""
    mission = Mission("navigation", (3.0, 0.0), 500.0, lambda: (x, y))
    if moving:
        mission.start()
    return mission, Commands(mission, Gate(), lambda: {"state": mission.orders.phase.value})


@pytest.mark.parametrize(
    "x",
    [10**400, float("nan"), 1e300, float("inf"), "1" + 400 * "0", "nan", "here", None, [1], {}, 3500.0, 691_608.0],
    ids=str,
)
def test_a_goal_that_cannot_be_meant_is_refused_in_one_sentence_and_the_next_command_is_obeyed(x):
    mission, commands = robot_at()
    with pytest.raises(CommandError) as refused:
        commands.carry_out("goal", {"x": x, "y": 5_335_832.0 if x == 691_608.0 else 0.0})
    assert "metres" in str(refused.value)
    assert len(str(refused.value)) < 300
    assert mission.orders.target == (3.0, 0.0)
    assert commands.carry_out("abort", {})["state"] == "aborted"


def test_how_far_a_goal_may_be_is_measured_from_the_robot():
    mission, commands = robot_at(691_608.0, 5_335_832.0)
    commands.carry_out("goal", {"x": 691_700.0, "y": 5_335_900.0})
    assert mission.orders.target == (691_700.0, 5_335_900.0)
    with pytest.raises(CommandError, match=r"within 500 m of the robot \(decision.goal_reach\)"):
        commands.carry_out("goal", {"x": 4.0, "y": 2.0})
    assert mission.orders.phase is Phase.RUNNING


def test_an_endless_command_is_refused_by_its_length():
    from deploy.bridge.words import parse

    with pytest.raises(CommandError, match="at most 1000 characters, got 2005"):
        parse("stop " + 2000 * "x")
