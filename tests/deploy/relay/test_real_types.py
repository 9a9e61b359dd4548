"""Our messages beside those of real ROS 2: hashes from its packages, bytes through its serialisers."""

import importlib
import json
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")

from ament_index_python.packages import get_package_share_directory
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.interfaces import Nodetype

from deploy.profiles import DEPLOY
from deploy.relay.descriptions import describe
from deploy.ros2.definitions import ACTION_SERVICES, SERVICES
from deploy.ros2.messages import deserialize, serialize, type_hash, typestore
from deploy.routes import routes_of

# What no wheel has: its parts are those of geometry_msgs, and its hash is checked against another implementation.
NOT_INSTALLED = {"tf2_msgs/msg/TFMessage"}
NOBODY_READS = {"__msgtype__", "structure_needs_at_least_one_member"}
DISTROS = ("jazzy", "kilted")
DTYPES = {"byte": np.uint8, "char": np.uint8}


def kinds_of_all_profiles():
    found = {"geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/TwistStamped", "rosgraph_msgs/msg/Clock"}
    for profile in DEPLOY.preset_names():
        config = DEPLOY.load(None, (), None, profile)
        found |= {route.kind for route in routes_of(config)}
    return sorted(found - NOT_INSTALLED)


KINDS = kinds_of_all_profiles()
PARTS = [f"{kind}_{part}" for kind in SERVICES | ACTION_SERVICES for part in ("Request", "Response")]


def described(kind):
    """What the package of a type tells about it."""
    package, folder, name = kind.split("/")
    # Wheels lie where Python does, installations where their set-up file says.
    share = Path(sys.prefix) / "share" / package
    if not share.is_dir():
        share = Path(get_package_share_directory(package))
    return json.loads((share / folder / f"{name}.json").read_text("utf-8"))


def real_hash(kind):
    return next(one["hash_string"] for one in described(kind)["type_hashes"] if one["type_name"] == kind)


def real_class(kind):
    package, folder, name = kind.split("/")
    name, _, part = name.partition("_")
    found = getattr(importlib.import_module(f"{package}.{folder}"), name)
    return getattr(found, part) if part else found


def filled(kind, random, distro):
    """A message with something in every field."""
    store = typestore(distro)
    return store.types[kind](**{name: value(field, random, distro) for name, field in store.fielddefs[kind][1]})


def value(field, random, distro):
    form, detail = field
    if form == Nodetype.NAME:
        return filled(detail, random, distro)
    if form == Nodetype.BASE:
        return scalar(detail[0], random)
    inner, length = detail
    count = length if form == Nodetype.ARRAY else int(random.integers(1, 4))
    if inner[0] == Nodetype.NAME or inner[1][0] == "string":
        return [value(inner, random, distro) for _ in range(count)]
    dtype = np.dtype(DTYPES.get(inner[1][0], inner[1][0]))
    return np.array([scalar(inner[1][0], random) for _ in range(count)], dtype)


def scalar(base, random):
    if base == "string":
        return "größer " * int(random.integers(0, 3))
    if base == "bool":
        return bool(random.integers(2))
    if base.startswith("float"):
        return float(np.float32(random.normal()))
    if base in DTYPES:
        return int(random.integers(128))
    bits = np.iinfo(np.dtype(base))
    return int(random.integers(max(bits.min, -(2**31)), min(bits.max, 2**31 - 1)))


def plain(part):
    """A message as nested lists: its bytes differ in what lies between fields."""
    if is_dataclass(part):
        return [plain(getattr(part, each.name)) for each in fields(part) if each.name not in NOBODY_READS]
    if isinstance(part, list | np.ndarray):
        return [plain(each) for each in part]
    return part


@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("kind", [*KINDS, *SERVICES, *ACTION_SERVICES, "action_msgs/msg/GoalStatusArray"])
def test_hashes_equal_those_of_the_packages(kind, distro):
    assert type_hash(kind, distro) == real_hash(kind)


@pytest.mark.parametrize("kind", [*KINDS, *PARTS])
def test_real_ros_reads_ours_and_we_read_theirs(kind):
    random = np.random.default_rng(len(kind))
    for _ in range(5):
        message = filled(kind, random, "kilted")
        ours = serialize(message, kind, "kilted")
        real = deserialize_message(ours, real_class(kind))
        theirs = serialize_message(real)
        # Fast CDR fills up to four bytes at the end.
        assert 0 <= len(theirs) - len(ours) < 4
        assert deserialize_message(theirs, real_class(kind)) == real
        assert plain(deserialize(theirs, kind, "kilted")) == plain(deserialize(ours, kind, "kilted")) == plain(message)


@pytest.mark.parametrize("distro", DISTROS)
def test_descriptions_of_types_made_here_are_those_that_are_hashed(distro):
    for kind in typestore(distro).fielddefs:
        assert describe(kind, distro).rihs01 == type_hash(kind, distro), kind


def test_descriptions_equal_those_of_the_packages():
    for kind in KINDS:
        real = described(kind)["type_description_msg"]
        ours = describe(kind, "kilted")
        found = [(one.name, one.type.type_id, one.type.capacity) for one in ours.type_description.fields]
        assert found == [
            (one["name"], one["type"]["type_id"], one["type"]["capacity"]) for one in real["type_description"]["fields"]
        ]
        names = [one.type_name for one in ours.referenced_type_descriptions]
        assert names == [one["type_name"] for one in real["referenced_type_descriptions"]]
