"""What the relay does for the robot when the watchdog's word no longer comes through."""

import json

import pytest

from deploy.profiles import load_deploy_config
from deploy.relay.standstill import WATCHDOG_SILENT, Standstill
from deploy.ros2 import message
from deploy.ros2.conversions import twist, velocity_from
from deploy.ros2.messages import deserialize, serialize

TWIST, STRING, INT8 = "geometry_msgs/msg/Twist", "std_msgs/msg/String", "std_msgs/msg/Int8"


class Wheels:
    """Where the relay sends to, and a clock."""

    def __init__(self, *overrides, stop=False):
        self.config = load_deploy_config(overrides=overrides)
        self.velocities, self.stops = [], []
        self.kind = f"geometry_msgs/msg/{self.config.driving.message}"
        self.standstill = Standstill(
            self.config.safety,
            self.config.driving.message,
            self.config.ros.distro,
            self.velocity,
            self.stop if stop else None,
        )
        self.now = 100.0

    def velocity(self, payload):
        self.velocities.append(velocity_from(deserialize(payload, self.kind)))

    def stop(self, payload):
        self.stops.append(deserialize(payload, INT8).data)

    def drive(self, speed):
        self.standstill.heard_velocity(serialize(twist(speed, 0.0), TWIST), self.now)

    def watchdog(self, mode):
        text = message(STRING, data=json.dumps({"mode": mode}))
        self.standstill.heard_watchdog(serialize(text, STRING), self.now)

    def wait(self, seconds):
        end = self.now + seconds
        while self.now < end:
            self.now += 0.05
            self.standstill.tick(self.now)


@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
def test_velocities_that_cease_end_in_zeros_for_a_while(kind):
    wheels = Wheels(f"driving.message={kind}")
    if kind == "Twist":
        wheels.drive(0.5)
    else:
        stamped = message(f"geometry_msgs/msg/{kind}", twist=twist(0.5, 0.0))
        wheels.standstill.heard_velocity(serialize(stamped, f"geometry_msgs/msg/{kind}"), wheels.now)
    wheels.wait(0.2)
    assert not wheels.velocities
    wheels.wait(0.2)
    assert wheels.standstill.stopping
    assert set(wheels.velocities) == {(0.0, 0.0)}
    wheels.wait(20.0)
    sent = len(wheels.velocities)
    assert 10 <= sent <= 10.0 * wheels.config.safety.zero_for + 2
    wheels.wait(5.0)
    assert len(wheels.velocities) == sent


def test_a_robot_that_stands_is_left_alone():
    wheels = Wheels()
    wheels.drive(0.5)
    wheels.drive(0.0)
    wheels.wait(10.0)
    wheels.standstill.leave()
    assert not wheels.velocities


def test_what_cannot_be_read_may_move_the_robot():
    wheels = Wheels()
    wheels.standstill.heard_velocity(b"nonsense", wheels.now)
    wheels.wait(0.5)
    assert wheels.velocities


@pytest.mark.parametrize("mode", ["clear", "held"])
def test_velocities_that_come_again_end_it(mode):
    wheels = Wheels()
    wheels.watchdog(mode)
    wheels.drive(0.5)
    wheels.wait(1.0)
    assert wheels.standstill.stopping
    wheels.drive(0.5)
    assert not wheels.standstill.stopping
    wheels.velocities.clear()
    wheels.wait(0.2)
    assert not wheels.velocities, "nothing of the relay's own between the velocities of the watchdog"


def test_a_stack_of_the_robots_own_is_stopped_when_the_watchdog_falls_silent_and_let_go_when_it_is_back():
    wheels = Wheels(stop=True)
    wheels.watchdog("clear")
    wheels.wait(WATCHDOG_SILENT - 0.2)
    assert not wheels.stops
    wheels.wait(0.5)
    assert set(wheels.stops) == {2}
    assert set(wheels.velocities) == {(0.0, 0.0)}
    wheels.watchdog("clear")
    assert wheels.stops[-1] == 0
    assert not wheels.standstill.stopping


@pytest.mark.parametrize("mode", ["held", "bridge_gone", "overridden"])
def test_a_watchdog_that_ends_in_order_is_not_missed(mode):
    wheels = Wheels(stop=True)
    wheels.watchdog("clear")
    wheels.watchdog(mode)
    wheels.wait(10.0)
    assert not wheels.stops
    assert not wheels.velocities


def test_a_relay_that_ends_stops_a_robot_under_way():
    wheels = Wheels(stop=True)
    wheels.drive(0.5)
    wheels.standstill.leave()
    assert (wheels.velocities, wheels.stops) == ([(0.0, 0.0)], [2])
