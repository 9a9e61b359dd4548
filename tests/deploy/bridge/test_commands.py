"""What a command may say, whoever sends it."""

import pytest

from deploy.bridge.command_text import CommandError, parse
from deploy.bridge.commands import Commands
from deploy.bridge.mission import Mission, Phase
from deploy.safety.geofence import Geofence


class Gate:
    """A watchdog that obeys at once, unless its topic latches the stop again."""

    def __init__(self):
        self.reason = ""
        self.pressed = False

    @property
    def latched(self):
        return bool(self.reason) or self.pressed

    def emergency_stop(self, reason):
        self.reason = reason

    def release(self):
        self.reason = ""


def robot_at(x=0.0, y=0.0, *, moving=True, gate=None):
    """The mission and the commands of a robot that navigates."""
    mission = Mission("navigation", (3.0, 0.0), 500.0, lambda: (x, y))
    if moving:
        mission.start()
    return mission, Commands(mission, gate or Gate(), lambda: {"state": mission.orders.phase.value})


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
    with pytest.raises(CommandError, match="at most 1000 characters, got 2005"):
        parse("stop " + 2000 * "x")


@pytest.mark.parametrize("paused", [False, True])
def test_a_release_needs_who_and_why_and_starts_nothing(paused):
    mission, commands = robot_at()
    if paused:
        mission.pause()
    assert commands.carry_out("stop", {"reason": "a person"})["state"] == "aborted"
    assert mission.orders.reason.startswith("emergency stop (a person) until it is released: the robot stands")
    for incomplete in ({}, {"who": "anna"}, {"why": "clear"}, {"who": " ", "why": "x"}, {"who": 1, "why": ["x"]}):
        with pytest.raises(CommandError, match="command release --who NAME --why REASON"):
            commands.carry_out("release", incomplete)
    for verb, arguments in (("start", {}), ("resume", {}), ("return_home", {}), ("goal", {"x": 1.0, "y": 1.0})):
        with pytest.raises(CommandError, match="the emergency stop is latched"):
            commands.carry_out(verb, arguments)
    assert commands.carry_out("release", {"who": "anna", "why": "clear"})["state"] == "aborted"
    # It stands, but not "until it is released".
    assert mission.orders.reason == "emergency stop released by anna: clear: the robot stands until it is told to start"
    with pytest.raises(CommandError, match="nothing to resume"):
        commands.carry_out("resume", {})
    assert commands.carry_out("goal", {"x": 4.0, "y": 0.0})["state"] == "aborted"
    assert commands.carry_out("start", {})["state"] == "running"


def test_a_release_that_another_node_overrules_fails():
    gate = Gate()
    _, commands = robot_at(gate=gate)
    gate.pressed = True
    with pytest.raises(CommandError, match="its topic says so again"):
        commands.carry_out("release", {"who": "anna", "why": "clear"})


def test_a_goal_outside_the_geofence_is_refused_and_the_last_one_stays():
    fence = Geofence(((-1.0, -1.0), (5.0, -1.0), (5.0, 5.0), (-1.0, 5.0)), 0.3)
    mission = Mission("exploration", permits=lambda target: fence.comes_near(target, 0.8))
    commands = Commands(mission, Gate(), lambda: {"state": mission.orders.phase.value})
    commands.carry_out("goal", {"x": 5.4, "y": 2.0})
    with pytest.raises(CommandError, match=r"inside the geofence \(safety.geofence\), \(5.6, 2\) does not"):
        commands.carry_out("goal", {"x": 5.6, "y": 2.0})
    assert mission.orders.target == (5.4, 2.0)
