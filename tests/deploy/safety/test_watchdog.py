"""Every safety event with real processes on a real bus; times are from the event to the first lasting zero."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.common.bus.processes import eventually, free_port
from tests.deploy.safety.robot import ZERO, Robot, bridge, configuration

# What three processes of tests on two cores may add, seconds; docs/deploy/safety.md has the times themselves.
LIMIT = 1.0


@pytest.fixture(scope="module")
def pair():
    config = configuration()
    with Robot(config) as robot, bridge(config) as other:
        yield robot, other, config.safety


@pytest.fixture
def driving(pair):
    """A robot that drives, after whatever the test before did to it."""
    robot, other, _ = pair
    other.tell("release")
    other.tell("command", 1.0, 0.2)
    assert eventually(lambda: other.state()["clear"] and robot.velocity() == (1.0, 0.2), 60.0)
    time.sleep(0.1)  # the release must not overtake the test's own stop
    return pair


@pytest.fixture
def mortal():
    """A pair of its own for a test that ends one of the processes."""
    config = configuration()
    with Robot(config) as robot, bridge(config) as other:
        assert eventually(lambda: robot.velocity() == (1.0, 0.2), 60.0)
        yield robot, other, config.safety


def report(event: str, seconds: float, timeout: float = 0.0) -> None:
    print(f"{event}: zero velocity after {1000 * seconds:.0f} ms (time-out {1000 * timeout:.0f} ms)")
    assert 0.0 <= seconds < timeout + LIMIT


def test_begins_with_zeros(driving):
    robot, _, _ = driving
    assert robot.velocities[0][1] == ZERO


def test_scan_stops(driving):
    robot, other, safety = driving
    robot.scanning = False
    report("scan stops", robot.time_to_zero(time.monotonic()), safety.scan_timeout)
    assert other.state()["mode"] == "sensor_stale"
    robot.scanning = True
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))


def test_pose_stops(driving):
    robot, other, safety = driving
    robot.posing = False
    report("pose stops", robot.time_to_zero(time.monotonic()), safety.pose_timeout)
    assert other.state()["mode"] == "pose_stale"
    robot.posing = True
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))


def test_bridge_is_killed(mortal):
    robot, other, safety = mortal
    now = time.monotonic()
    os.kill(other.pid, signal.SIGKILL)
    report("bridge killed", robot.time_to_zero(now))
    assert eventually(lambda: not alive(other.watchdog), safety.zero_for + 2.0)
    assert robot.velocities[-1][0] - now > safety.zero_for - 0.3
    assert robot.stops[-1][1] == 2


def test_bridge_hangs_and_comes_back(driving):
    robot, other, safety = driving
    now = time.monotonic()
    os.kill(other.pid, signal.SIGSTOP)
    report("bridge stopped by SIGSTOP", robot.time_to_zero(now), safety.bridge_timeout)
    os.kill(other.pid, signal.SIGCONT)
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))


def test_wishes_stop(driving):
    robot, other, safety = driving
    report("velocity commands stop", robot.time_to_zero(other.tell("command")), safety.bridge_timeout)
    assert other.state()["mode"] == "command_stale"


def test_bridge_holds(driving):
    robot, other, _ = driving
    other.tell("command")
    report("hold", robot.time_to_zero(other.tell("hold", "the policy failed")))
    assert other.state()["reason"] == "the policy failed"


def test_emergency_stop_latches(driving):
    robot, other, _ = driving
    report("emergency stop", robot.time_to_zero(robot.emergency_stop()))
    robot.emergency_stop(False)
    time.sleep(0.3)
    assert robot.velocity() == ZERO
    assert other.state()["mode"] == "emergency_stop"
    other.tell("release")
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))


def test_joystick_takes_over(driving):
    robot, other, safety = driving
    report("joystick", robot.time_to_zero(robot.joystick(0.0, 0.7)))
    time.sleep(0.5)
    count = len(robot.velocities)
    time.sleep(0.3)
    assert len(robot.velocities) == count  # the topic is the operator's alone
    assert other.state()["mode"] == "overridden"
    released = robot.joystick(0.0, 0.0)
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))
    assert time.monotonic() - released > safety.joy_release


def test_another_bridge_for_the_same_robot_holds_both_and_one_for_another_robot_neither(driving):
    robot, other, _ = driving
    elsewhere = configuration(
        ros={"connect": robot.config.ros.connect}, topics={"velocity": "/r2/cmd_vel", "stop": "/r2/stop"}
    )
    with bridge(elsewhere) as neighbour:
        assert eventually(lambda: neighbour.state()["clear"], 60.0)
        time.sleep(1.5)
        assert other.state()["clear"]
    # Its name may be any: it has no say here.
    with bridge(robot.config.model_copy(update={"name": "twin"})) as twin:
        assert eventually(lambda: twin.state()["mode"] == other.state()["mode"] == "rival", 60.0)
        report("rival", robot.time_to_zero(time.monotonic()))
        time.sleep(3.0)
        assert robot.velocity() == ZERO
        assert "another bridge commands this robot too" in other.state()["reason"]
    assert eventually(lambda: other.state()["clear"] and robot.velocity() == (1.0, 0.2), 10.0)


def test_speed_is_limited(driving):
    robot, other, safety = driving
    other.tell("command", 8.0, 0.0)
    assert eventually(lambda: robot.velocity() == (safety.speed_limit, 0.0))
    assert max(abs(v) for _, (v, _) in robot.velocities) <= safety.speed_limit
    other.tell("command", 0.0, -9.0)
    assert eventually(lambda: robot.velocity() == (0.0, -safety.turn_limit))


@pytest.mark.slow
def test_orderly_end(mortal):
    robot, other, _ = mortal
    now = other.tell("end")
    report("orderly end", robot.time_to_zero(now))
    other.process.wait(10)
    assert other.process.returncode == 0
    assert not alive(other.watchdog)


@pytest.mark.slow
def test_service_stop_reaches_the_watchdog_alone(mortal):
    robot, other, _ = mortal
    now = time.monotonic()
    os.kill(other.watchdog, signal.SIGTERM)
    report("watchdog told to end", robot.time_to_zero(now))


def test_ctrl_c_does_not_reach_the_watchdog(driving):
    robot, other, _ = driving
    assert os.getpgid(other.watchdog) != os.getpgid(other.pid)
    os.kill(other.watchdog, signal.SIGINT)
    time.sleep(0.3)
    assert robot.velocity() == (1.0, 0.2)


@pytest.mark.slow
def test_dead_watchdog_stops_the_robot_all_the_same(driving):
    robot, other, _ = driving
    now = time.monotonic()
    os.kill(other.watchdog, signal.SIGKILL)
    report("watchdog killed", robot.time_to_zero(now))
    assert eventually(lambda: robot.velocity() == (1.0, 0.2), 30.0)
    other.watchdog = other.state()["pid"]


@pytest.mark.slow
def test_hanging_watchdog_is_replaced(driving):
    robot, other, _ = driving
    now = time.monotonic()
    os.kill(other.watchdog, signal.SIGSTOP)
    report("watchdog stopped by SIGSTOP", robot.time_to_zero(now), 0.6)
    assert not other.state()["alive"]
    assert eventually(lambda: other.state()["pid"] != other.watchdog and other.state()["clear"], 60.0)
    assert eventually(lambda: robot.velocity() == (1.0, 0.2), 30.0)
    other.watchdog = other.state()["pid"]


@pytest.mark.slow
def test_dead_watchdog_is_replaced_and_the_latch_stays(driving):
    robot, other, _ = driving
    robot.emergency_stop()
    assert eventually(lambda: other.state()["mode"] == "emergency_stop")
    os.kill(other.watchdog, signal.SIGKILL)
    assert eventually(lambda: other.state()["pid"] != other.watchdog and other.state()["alive"])
    assert other.state()["mode"] == "emergency_stop"
    other.tell("release")
    assert eventually(lambda: robot.velocity() == (1.0, 0.2))
    other.watchdog = other.state()["pid"]


@pytest.mark.slow
def test_robot_that_connects_to_the_bridge_is_stopped_when_the_bridge_dies():
    port = free_port()
    config = configuration(ros={"connect": (), "listen": (f"tcp/0.0.0.0:{port}",)})
    with bridge(config) as other, Robot(config) as robot:
        assert eventually(lambda: robot.velocity() == (1.0, 0.2), 60.0)
        now = time.monotonic()
        os.kill(other.pid, signal.SIGKILL)
        report("bridge that listens killed", robot.time_to_zero(now))


@pytest.mark.slow
def test_old_watchdog_gives_way_to_that_of_a_new_bridge():
    config = configuration(safety={"zero_for": 60.0})
    with Robot(config) as robot, bridge(config) as old:
        assert eventually(lambda: robot.velocity() == (1.0, 0.2), 60.0)
        os.kill(old.pid, signal.SIGKILL)
        robot.time_to_zero(time.monotonic())
        with bridge(config):
            assert eventually(lambda: not alive(old.watchdog), 30.0)
            assert eventually(lambda: robot.velocity() == (1.0, 0.2), 30.0)
            time.sleep(0.3)
            since = time.monotonic()
            time.sleep(0.5)
            assert {value for when, value in robot.velocities if when > since} == {(1.0, 0.2)}


@pytest.mark.slow
def test_robot_gets_its_own_type_and_clock():
    config = configuration(driving={"enabled": True, "message": "TwistStamped"})
    with Robot(config) as robot, bridge(config):
        assert eventually(lambda: robot.velocity() == (1.0, 0.2))
        assert 999.0 < robot.stamps[-1] < 1010.0  # the stamps of its poses are at 1000 s


@pytest.mark.slow
def test_own_stack_is_stopped_only_by_faults():
    config = configuration(
        driving={"enabled": False}, sensing={"source": "points"}, topics={"points": "/points", "stop": "/stop"}
    )
    with Robot(config) as robot, bridge(config) as other:
        other.tell("command")
        other.tell("resume")
        assert eventually(lambda: other.state()["clear"])
        assert eventually(lambda: robot.stops and robot.stops[-1][1] == 0)
        count = len(robot.velocities)
        time.sleep(0.3)
        assert len(robot.velocities) == count
        now = time.monotonic()
        robot.scanning = False
        assert eventually(lambda: robot.stops[-1][1] == 2)
        report("cloud stops, own stack drives: /stop", robot.stops[-1][0] - now, config.safety.scan_timeout)
        assert robot.velocity() == ZERO
        robot.scanning = True
        assert eventually(lambda: robot.stops[-1][1] == 0)
        assert eventually(lambda: robot.status[-1]["mode"] == "clear")


@pytest.mark.slow
def test_transforms_of_slam_alone_are_no_pose():
    config = configuration(sensing={"pose": "tf"})
    with Robot(config) as robot, bridge(config):
        assert eventually(lambda: robot.velocity() == (1.0, 0.2))
        robot.posing = False
        report("odometry's transform stops", robot.time_to_zero(time.monotonic()), config.safety.pose_timeout)


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return not is_zombie(pid)


def is_zombie(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def test_a_robot_that_leaves_the_fence_is_stopped_without_the_bridge():
    config = configuration(safety={"geofence": [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)]})
    with Robot(config) as robot, bridge(config) as other:
        assert eventually(lambda: robot.velocity() == (1.0, 0.2), 60.0)
        robot.position = (2.5, 0.0)
        report("the fence is crossed", robot.time_to_zero(time.monotonic()))
        state = other.state()
        assert state["mode"] == "outside"
        assert "(2.50, 0.00)" in state["reason"]
        robot.position = (1.5, 0.0)
        assert eventually(lambda: robot.velocity() == (1.0, 0.2)), "driven back, it continues"


def test_it_starts_without_what_it_does_not_need():
    heavy = "numba", "shapely", "scipy", "typer", "common.mapping", "deploy.bridge"
    code = f"import sys, deploy.safety.watchdog; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
