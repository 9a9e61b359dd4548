import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.ros2 import conversions as convert
from deploy.ros2.errors import RosError
from tests.deploy.ros2.wire import over_the_wire


@given(st.floats(-2, 2), st.floats(-3, 3))
def test_velocities_round_trip(linear, angular):
    plain = over_the_wire(convert.twist(linear, angular), "geometry_msgs/msg/Twist")
    stamped = over_the_wire(convert.twist_stamped(1.0, "base", linear, angular), "geometry_msgs/msg/TwistStamped")
    assert convert.velocity_from(plain) == convert.velocity_from(stamped) == (linear, angular)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_velocities_that_are_not_finite_are_refused(value):
    with pytest.raises(RosError, match="finite"):
        convert.velocity_from(convert.twist(value, 0.0))
