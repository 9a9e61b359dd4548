import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.robot.drive_base import DriveBase
from deploy.robot.options import RobotOptions

DT = 1.0 / 60.0


def drive(base, seconds, began=0.0):
    """Advance with the wall's clock running as the robot's; return the velocities."""
    return [base.advance(began + k * DT, began + k * DT, DT) for k in range(round(seconds / DT))]


def test_the_base_ramps_to_the_velocity_and_keeps_it_while_commands_come():
    base = DriveBase(RobotOptions(acceleration=2.0))
    speeds = []
    for k in range(60):
        base.receive(1.0, 0.5, now=k * DT, due=k * DT)
        speeds.append(base.advance(k * DT, k * DT, DT)[0])
    assert speeds[0] == pytest.approx(2.0 * DT)
    assert speeds[28] < 1.0
    assert speeds[-1] == 1.0
    assert base.commanded == (1.0, 0.5)


def test_without_new_commands_the_base_stops_after_the_time_out():
    base = DriveBase(RobotOptions(command_timeout=0.5, deceleration=4.0))
    for k in range(60):
        base.receive(1.0, 0.0, now=k * DT, due=k * DT)
        base.advance(k * DT, k * DT, DT)
    speeds = [speed for speed, _ in drive(base, 1.0, began=1.0)]
    assert speeds[round(0.45 / DT)] == 1.0
    assert speeds[round(0.5 / DT) + round(0.25 / DT) + 2] == 0.0


def test_the_time_out_runs_on_the_walls_clock_however_fast_the_robot_lives():
    base = DriveBase(RobotOptions(command_timeout=0.5, acceleration=1000.0))
    base.receive(1.0, 0.0, now=0.0, due=0.0)
    assert base.advance(now=0.1, time=1.0, interval=DT)[0] == 1.0
    assert base.advance(now=0.4, time=4.0, interval=DT)[0] == 1.0
    assert base.advance(now=0.6, time=6.0, interval=DT)[0] < 1.0


def test_in_slow_motion_the_time_out_is_the_robots():
    base = DriveBase(RobotOptions(command_timeout=0.5, acceleration=1000.0, speed_factor=0.1))
    base.receive(1.0, 0.0, now=0.0, due=0.0)
    assert base.advance(now=4.0, time=0.4, interval=DT)[0] == 1.0
    assert base.advance(now=6.0, time=0.6, interval=DT)[0] < 1.0


def test_a_command_waits_for_its_latency():
    base = DriveBase(RobotOptions(acceleration=1000.0))
    base.receive(1.0, 0.0, now=0.0, due=0.2)
    assert base.advance(0.1, 0.1, DT) == (0.0, 0.0)
    assert base.advance(0.21, 0.21, DT)[0] == 1.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_a_number_is_refused(bad):
    base = DriveBase(RobotOptions())
    base.receive(bad, 0.0, 0.0, 0.0)
    base.receive(0.0, bad, 0.0, 0.0)
    assert base.refused == 2
    assert base.advance(0.0, 0.0, DT) == (0.0, 0.0)


@given(
    st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=1, max_size=50),
)
def test_limits_hold_for_any_commands(commands):
    options = RobotOptions(max_speed=1.5, max_turn_rate=2.0)
    base = DriveBase(options)
    before = (0.0, 0.0)
    for k, (speed, turn_rate) in enumerate(commands):
        base.receive(speed, turn_rate, now=k * DT, due=k * DT)
        now = base.advance(k * DT, k * DT, DT)
        assert abs(now[0]) <= 1.5
        assert abs(now[1]) <= 2.0
        assert abs(now[0] - before[0]) <= options.deceleration * DT + 1e-12
        assert abs(now[1] - before[1]) <= options.turn_acceleration * DT + 1e-12
        before = now
