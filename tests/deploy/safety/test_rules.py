import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.config import SafetyConfig
from deploy.safety.gate_state import GateMode
from deploy.safety.rules import GateRules, clip

ZERO = (0.0, 0.0)


def make(*, driving=True, **safety) -> GateRules:
    return GateRules(SafetyConfig(**safety), "scan", now=0.0, drives=driving)


def healthy(rules: GateRules, now: float, command=(0.5, 0.1)) -> GateRules:
    rules.sensor_time = rules.pose_time = now
    rules.bridge_lives(now)
    if command is not None:
        rules.command(now, *command)
    return rules


def test_fresh_wishes_pass():
    decision = healthy(make(), 1.0).decide(1.0)
    assert decision.mode is GateMode.CLEAR
    assert decision.velocity == (0.5, 0.1)
    assert decision.stop == 0


def test_starts_with_zeros():
    decision = make().decide(0.0)
    assert decision.velocity == ZERO
    assert decision.stop == 2
    assert "no scan received yet" in decision.reason


@pytest.mark.parametrize(
    ("attribute", "mode", "word"),
    [("sensor_time", GateMode.SENSOR_STALE, "no scan for 1 s"), ("pose_time", GateMode.POSE_STALE, "no pose for 1 s")],
)
def test_stale_inputs_stop(attribute, mode, word):
    rules = healthy(make(scan_timeout=1.0, pose_timeout=1.0), 10.0)
    setattr(rules, attribute, 8.9)
    decision = rules.decide(10.0)
    assert (decision.mode, decision.velocity, decision.stop) == (mode, ZERO, 2)
    assert decision.reason == word


def test_a_map_that_came_once_is_enough():
    rules = GateRules(SafetyConfig(), "grid", now=0.0, drives=True)
    assert rules.decide(0.0).mode is not GateMode.CLEAR
    healthy(rules, 1.0)
    healthy(rules, 500.0)
    rules.sensor_time = 1.0
    assert rules.decide(500.0).mode is GateMode.CLEAR


def test_a_robot_outside_the_fence_is_stopped_but_an_operator_can_drive_it_back():
    rules = healthy(make(joy_release=2.0), 1.0)
    rules.outside = "(7.00, 0.00)"
    decision = rules.decide(1.0)
    assert (decision.mode, decision.velocity, decision.stop) == (GateMode.OUTSIDE, ZERO, 2)
    assert "(7.00, 0.00)" in decision.reason
    rules.joystick([1.0, 0.0, 0.0, 0.0, 0.0], 1.0)
    assert rules.decide(1.0).mode is GateMode.OVERRIDDEN
    rules.outside = ""
    assert healthy(rules, 9.0).decide(9.0).mode is GateMode.OVERRIDDEN, "the stick is still held"
    rules.joystick([0.0] * 5, 9.0)
    assert healthy(rules, 12.0).decide(12.0).mode is GateMode.CLEAR


def test_a_rival_holds_until_it_has_been_silent_for_a_while():
    rules = healthy(make(), 1.0)
    rules.rival_time = 1.0
    decision = rules.decide(1.0)
    assert (decision.mode, decision.velocity, decision.stop) == (GateMode.RIVAL, ZERO, 2)
    assert healthy(rules, 3.4).decide(3.4).mode is GateMode.RIVAL
    assert healthy(rules, 3.6).decide(3.6).mode is GateMode.CLEAR


def test_silent_bridge_stops_and_may_come_back():
    rules = healthy(make(bridge_timeout=0.3), 1.0)
    assert rules.decide(1.29).mode is GateMode.CLEAR
    assert rules.decide(1.31).mode is GateMode.BRIDGE_SILENT
    healthy(rules, 1.4)
    assert rules.decide(1.4).mode is GateMode.CLEAR


def test_beats_without_wishes_do_not_drive():
    rules = healthy(make(bridge_timeout=0.3), 1.0)
    rules.bridge_lives(1.5)
    rules.sensor_time = rules.pose_time = 1.5
    decision = rules.decide(1.5)
    assert (decision.mode, decision.velocity) == (GateMode.COMMAND_STALE, ZERO)


def test_late_packets_do_not_make_the_bridge_younger():
    rules = healthy(make(bridge_timeout=0.3), 1.0)
    rules.bridge_lives(0.2)
    assert rules.decide(1.2).mode is GateMode.CLEAR


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_wish_that_is_not_finite_stops(bad):
    assert healthy(make(), 1.0, (bad, 0.0)).decide(1.0).velocity == ZERO
    assert healthy(make(), 1.0, (0.0, bad)).decide(1.0).velocity == ZERO


def test_hold_lasts_until_the_next_wish_or_resume():
    rules = healthy(make(), 1.0)
    rules.hold("planner failed")
    decision = rules.decide(1.0)
    assert (decision.mode, decision.velocity, decision.reason) == (GateMode.HELD, ZERO, "planner failed")
    rules.command(1.0, 0.3, 0.0)
    assert rules.decide(1.0).velocity == (0.3, 0.0)

    other = healthy(make(driving=False), 1.0, None)
    other.hold("paused")
    assert other.decide(1.0).stop == 2
    other.resume()
    assert other.decide(1.0).stop == 0


def test_emergency_stop_latches_until_released():
    rules = healthy(make(), 1.0)
    rules.latch("button")
    rules.joystick([1.0, 0.0], 1.0)
    for now in (1.0, 60.0):
        decision = healthy(rules, now).decide(now)
        assert (decision.mode, decision.velocity, decision.stop) == (GateMode.EMERGENCY_STOP, ZERO, 2)
        assert "button" in decision.reason
    rules.joystick([0.0, 0.0], 61.0)
    rules.release()
    assert healthy(rules, 80.0).decide(80.0).mode is GateMode.CLEAR


def test_operator_gets_zeros_then_silence_then_the_bridge_goes_on():
    rules = healthy(make(joy_release=3.0), 1.0)
    rules.joystick([0.0, 0.8], 1.0)
    assert rules.decide(1.0).velocity == ZERO
    assert rules.decide(1.0).mode is GateMode.OVERRIDDEN
    assert rules.decide(2.0).velocity is None
    # Held steady, the joystick need not send anything.
    assert rules.decide(60.0).velocity is None
    rules.joystick([0.0, 0.05], 60.0)
    assert healthy(rules, 62.9).decide(62.9).mode is GateMode.OVERRIDDEN
    assert healthy(rules, 63.1).decide(63.1).velocity == (0.5, 0.1)


def test_operator_is_left_alone_by_other_faults():
    rules = healthy(make(), 1.0)
    rules.joystick([1.0], 1.0)
    rules.decide(1.0)
    rules.bridge_died(2.0, "dead")
    assert rules.decide(30.0).velocity is None


def test_dead_bridge_gets_zeros_for_a_while_and_the_watchdog_ends():
    rules = healthy(make(zero_for=5.0), 1.0)
    rules.bridge_died(1.0, "killed")
    first = rules.decide(1.0)
    assert (first.mode, first.velocity, first.ended) == (GateMode.BRIDGE_GONE, ZERO, False)
    assert not rules.decide(5.9).ended
    assert rules.decide(6.0).ended


def test_orderly_end_is_quick_and_stops_the_robot():
    rules = healthy(make(zero_for=5.0), 1.0)
    rules.finish(1.0)
    assert rules.decide(1.0).velocity == ZERO
    assert rules.decide(1.5).ended


def test_own_stack_is_left_alone_until_something_is_wrong():
    rules = healthy(make(driving=False), 1.0, None)
    well = rules.decide(1.0)
    assert (well.mode, well.velocity, well.stop) == (GateMode.CLEAR, None, 0)
    rules.sensor_time = -5.0
    ill = rules.decide(1.0)
    assert (ill.velocity, ill.stop) == (ZERO, 2)


def test_reason_does_not_change_while_nothing_changes():
    rules = make()
    assert {rules.decide(now).reason for now in (5.0, 6.0, 7.0)} == {"the bridge said nothing for 0.3 s"}


def test_triggers_that_rest_at_one_do_not_take_over():
    rules = healthy(make(), 1.0)
    rules.joystick([0.0, 0.0, 1.0, 0.0, 0.0, 1.0], 1.0)
    assert rules.decide(1.0).mode is GateMode.CLEAR
    every = healthy(make(joy_axes=()), 1.0)
    every.joystick([0.0, 0.0, 1.0], 1.0)
    assert every.decide(1.0).mode is GateMode.OVERRIDDEN


def test_a_joystick_without_the_axes_that_were_chosen_takes_over_by_any():
    rules = healthy(make(joy_axes=(3, 4)), 1.0)
    rules.joystick([0.0, 0.0], 1.0)
    assert rules.decide(1.0).mode is GateMode.CLEAR
    rules.joystick([0.0, 0.6], 1.0)
    assert rules.decide(1.0).mode is GateMode.OVERRIDDEN


@given(
    st.floats(-1e6, 1e6),
    st.floats(-1e6, 1e6),
    st.floats(0.01, 10.0),
    st.floats(0.01, 10.0),
)
def test_clipped_velocities_keep_limits_signs_and_arc(linear, angular, speed, turn):
    config = SafetyConfig(speed_limit=speed, turn_limit=turn)
    (v, w), clipped = clip(linear, angular, config)
    assert abs(v) <= speed
    assert abs(w) <= turn
    assert clipped == (abs(linear) > speed or abs(angular) > turn)
    assert v * linear >= 0.0
    assert w * angular >= 0.0
    assert v * angular == pytest.approx(w * linear, rel=1e-6, abs=1e-9)
