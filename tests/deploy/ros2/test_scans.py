import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common.geometry import Scan
from deploy.ros2 import conversions as convert
from deploy.ros2.errors import RosError
from tests.deploy.ros2.wire import few, over_the_wire, stamps


@few
@given(
    stamps,
    hnp.arrays(np.float32, st.integers(0, 50), elements=st.floats(0, 100, width=32)),
    st.floats(-3.0, 3.0, width=32),
    st.floats(0.0009765625, 0.125, width=32),
)
def test_scans_round_trip(stamp, ranges, first, step):
    scan = Scan(ranges, first, step, 20.0, 0.25)
    there = over_the_wire(convert.laser_scan(stamp, "laser", scan), "sensor_msgs/msg/LaserScan")
    back = convert.scan_from(there)
    assert np.array_equal(back.ranges, ranges)
    assert (back.angle_min, back.angle_increment, back.range_max, back.range_min) == (first, step, 20.0, 0.25)
    assert there.angle_max == pytest.approx(first + max(len(ranges) - 1, 0) * step, abs=1e-4)


@pytest.mark.parametrize(
    ("field", "value"),
    [("angle_min", math.nan), ("angle_increment", 0.0), ("range_max", math.nan), ("range_min", 30.0)],
)
def test_scans_without_sense_are_refused(field, value):
    scan = convert.laser_scan(0.0, "laser", Scan(np.ones(3, np.float32), 0.0, 0.1, 20.0))
    setattr(scan, field, value)
    with pytest.raises(RosError, match="LaserScan"):
        convert.scan_from(scan)


def test_a_scan_without_a_limit_is_taken():
    scan = convert.laser_scan(1.0, "laser", Scan(np.full(360, 3.0, np.float32), -math.pi, math.radians(1.0), 20.0, 0.1))
    scan.range_max = math.inf
    back = convert.scan_from(scan)
    assert math.isfinite(back.range_max) and back.range_max > 1e30
    assert back.ranges.tolist() == scan.ranges.tolist()


def test_scans_beyond_reason_are_refused_by_name():
    with pytest.raises(RosError, match="radians.*degrees"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), -180.0, 0.5, 30.0)))
    with pytest.raises(RosError, match="metres.*millimetres"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(4, np.float32), 0.0, 0.5, 3e4, 100.0)))
    with pytest.raises(RosError, match="at most 131072 beams"):
        convert.scan_from(convert.laser_scan(1.0, "laser", Scan(np.ones(200_000, np.float32), 0.0, 1e-4, 30.0)))
