"""Messages through the bytes that go over the wire, and what they are drawn from."""

import math

from hypothesis import settings
from hypothesis import strategies as st

from common.geometry import Pose
from deploy.ros2.messages import deserialize, serialize

# Arrays are slow to draw.
few = settings(max_examples=25)
metres = st.floats(-1e4, 1e4)
stamps = st.floats(0.0, 2e9)
poses = st.builds(Pose, metres, metres, st.floats(-3.1, 3.1))


def over_the_wire(value, kind):
    return deserialize(serialize(value, kind), kind)


def close(a: Pose, b: Pose) -> bool:
    turn = math.remainder(a.yaw - b.yaw, 2 * math.pi)
    return a.x == b.x and a.y == b.y and abs(turn) < 1e-9
