import dataclasses
import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deploy.ros2.errors import RosError
from deploy.ros2.messages import deserialize, header, message, seconds, serialize, stamp, type_hash, typestore
from tests.deploy.ros2.network import KINDS

LIMITS = {"float32": 2.0**100, "float64": 2.0**1000}


@functools.cache
def fields_strategy(kind: str, distro: str = "jazzy"):
    """Any valid message of a type."""
    fields = {}
    for name, description in typestore(distro).fielddefs[kind][1]:
        fields[name] = _value(description)
    return st.builds(message, st.just(kind), **fields)


def _value(description):
    form, detail = description
    if form.name == "NAME":
        return fields_strategy(detail)
    if form.name == "BASE":
        return _scalar(detail[0])
    inner, length = detail
    if inner[0].name == "BASE" and inner[1][0] != "string":
        dtype = np.dtype({"byte": "u1", "char": "u1"}.get(inner[1][0], inner[1][0]))
        size = st.just(length) if form.name == "ARRAY" else st.integers(0, 5)
        return st.builds(
            lambda n, seed: np.random.default_rng(seed).integers(0, 100, n).astype(dtype), size, st.just(1)
        )
    count = {"min_size": length, "max_size": length} if form.name == "ARRAY" else {"max_size": 2}
    return st.lists(_value(inner), **count)


def _scalar(base):
    if base == "string":
        return st.text(max_size=8).filter(lambda text: "\0" not in text)
    if base == "bool":
        return st.booleans()
    if base in LIMITS:
        return st.floats(-LIMITS[base], LIMITS[base], width=int(base[-2:]))
    info = np.iinfo({"byte": "u1", "char": "u1"}.get(base, base))
    return st.integers(int(info.min), int(info.max))


def same(a, b) -> bool:
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


@pytest.mark.parametrize("distro", ["humble", "jazzy", "kilted"])
@pytest.mark.parametrize("kind", KINDS)
def test_defaults_serialise_and_come_back(kind, distro):
    empty = message(kind, distro)
    assert same(empty, deserialize(serialize(empty, kind, distro), kind, distro))


@settings(max_examples=30)
@given(st.data())
def test_any_message_comes_back(data):
    kind = data.draw(st.sampled_from(KINDS))
    original = data.draw(fields_strategy(kind))
    payload = serialize(original, kind)
    assert payload[:4] == b"\0\1\0\0"
    assert same(original, deserialize(payload, kind))


@given(st.sampled_from(KINDS), st.binary(max_size=400))
def test_noise_is_no_message(kind, noise):
    """Whatever comes in, only RosError comes out: nothing else would be caught."""
    for payload in (noise, b"\0\1\0\0" + noise):
        try:
            deserialize(payload, kind)
        except RosError as error:
            assert kind in str(error)


@settings(max_examples=30)
@given(st.data())
def test_damaged_messages_raise_or_parse(data):
    kind = data.draw(st.sampled_from(KINDS))
    payload = bytearray(serialize(data.draw(fields_strategy(kind)), kind))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        deserialize(bytes(payload[: data.draw(st.integers(0, len(payload)))]), kind)
    except RosError as error:
        assert kind in str(error)


@pytest.mark.parametrize("kind", ["sensor_msgs/msg/LaserScan", "nav_msgs/msg/Path", "std_msgs/msg/String"])
def test_claimed_lengths_allocate_nothing(kind):
    payload = serialize(message(kind), kind)
    claim = payload[:4] + payload[4:].replace(b"\0\0\0\0", b"\xff\xff\xff\x7f")
    with pytest.raises(RosError, match="no "):
        deserialize(claim, kind)


def test_rotation_starts_at_none():
    assert message("geometry_msgs/msg/Pose").orientation.w == 1.0
    assert message("nav_msgs/msg/Odometry").pose.pose.orientation.w == 1.0


def test_lists_become_arrays_of_the_fields_type():
    scan = message("sensor_msgs/msg/LaserScan", ranges=[1, 2.5])
    assert scan.ranges.dtype == np.float32
    assert message("nav_msgs/msg/OccupancyGrid", data=[-1, 100]).data.dtype == np.int8


def test_errors_name_the_field():
    with pytest.raises(RosError, match="no field rangs"):
        message("sensor_msgs/msg/LaserScan", rangs=[])
    with pytest.raises(RosError, match=r"LaserScan\.ranges must be numbers"):
        message("sensor_msgs/msg/LaserScan", ranges=["far"])
    with pytest.raises(RosError, match="jazzy has no message type"):
        message("sensor_msgs/msg/LaserScam")
    with pytest.raises(RosError, match="humble, jazzy, kilted"):
        message("std_msgs/msg/Bool", "foxy")
    with pytest.raises(RosError, match="cannot serialise"):
        serialize(message("std_msgs/msg/Int8", data=1000), "std_msgs/msg/Int8")


@given(st.floats(0.0, 2**31 - 1))
def test_stamps_come_back(time):
    assert seconds(stamp(time)) == pytest.approx(time, abs=1e-6)


@pytest.mark.parametrize("time", [-1.0, float("nan"), float("inf"), 2.0**31])
def test_stamps_out_of_range_are_refused(time):
    with pytest.raises(RosError, match="check the clock"):
        stamp(time)


def test_hashes_are_those_of_ros():
    # As in the keys that the design document of rmw_zenoh shows.
    assert type_hash("std_msgs/msg/String") == "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"


def test_stamps_of_headers():
    assert header(12.25, "map").stamp.nanosec == 250_000_000
