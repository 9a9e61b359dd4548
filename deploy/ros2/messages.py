"""ROS 2 messages without ROS: `rosbags` dataclasses with defaults, and CDR."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from deploy.ros2.definitions import add_services
from deploy.ros2.errors import RosError

Message = Any
"""A message: a dataclass of the typestore, whose fields are named as in the ROS definition."""

STORES = {"humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY, "kilted": Stores.ROS2_KILTED}
ALIASES = {"byte": "uint8", "char": "uint8"}
# ROS starts a quaternion at no rotation, not at zero.
DEFAULTS: dict[tuple[str, str], float] = {("geometry_msgs/msg/Quaternion", "w"): 1.0}


@functools.cache
def typestore(distro: str = "jazzy") -> Typestore:
    """Return the message definitions of a ROS 2 distribution, with those of the services that are used here.

    Raises:
        RosError: for a distribution other than humble, jazzy and kilted.
    """
    if distro not in STORES:
        raise RosError(f"ROS 2 distribution must be one of {', '.join(STORES)}, got {distro!r}: correct ros.distro")
    store = get_typestore(STORES[distro])
    add_services(store)
    return store


def check_kind(kind: str, distro: str = "jazzy") -> str:
    """Return a type's name, such as `geometry_msgs/msg/Twist`, if the distribution defines it.

    Raises:
        RosError: when it does not.
    """
    if kind not in typestore(distro).fielddefs:
        raise RosError(f"{distro} has no message type {kind!r}: name it as in sensor_msgs/msg/LaserScan")
    return kind


def message(kind: str, distro: str = "jazzy", **fields: Any) -> Message:
    """Build a message; fields that are not given are zero, empty, false or no rotation.

    Numbers given for arrays may be lists; they become arrays of the field's type.

    Args:
        kind: such as `geometry_msgs/msg/Twist`.
        distro: distribution whose definition is meant.
        fields: values by field name.

    Raises:
        RosError: for an unknown type or field, or numbers that do not fit an array's type.
    """
    makers = _makers(check_kind(kind, distro), distro)
    unknown = fields.keys() - makers.keys()
    if unknown:
        raise RosError(f"{kind} has no field {', '.join(sorted(unknown))}: its fields are {', '.join(makers)}")
    values = {}
    for name, (make, dtype) in makers.items():
        if name not in fields:
            values[name] = make()
        elif dtype is not None:
            values[name] = _array(fields[name], dtype, f"{kind}.{name}")
        else:
            values[name] = fields[name]
    return typestore(distro).types[kind](**values)


def header(seconds_: float = 0.0, frame: str = "") -> Message:
    """Build a std_msgs/Header from a stamp in seconds and a frame."""
    return message("std_msgs/msg/Header", stamp=stamp(seconds_), frame_id=frame)


def stamp(time: float) -> Message:
    """Return a builtin_interfaces/Time of a time in seconds.

    Raises:
        RosError: when the time is not finite, negative or beyond 2038.
    """
    if not math.isfinite(time) or not 0.0 <= time < 2**31:
        raise RosError(f"a stamp must be finite seconds from 0 to 2^31, got {time!r}: check the clock")
    nanoseconds = round(time * 1e9)
    return message("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds(time: Message) -> float:
    """Return a builtin_interfaces/Time in seconds; doubles hold today's stamps to 0.3 us."""
    return float(time.sec + time.nanosec * 1e-9)


def serialize(value: Message, kind: str, distro: str = "jazzy") -> bytes:
    """Return a message as little-endian CDR with its encapsulation header.

    Raises:
        RosError: when a field's value does not fit its type.
    """
    try:
        return bytes(typestore(distro).serialize_cdr(value, kind, little_endian=True))
    except Exception as error:
        # rosbags compiles its serialisers: whatever a wrong value raises there comes out as it is.
        raise RosError(f"cannot serialise {kind}: {type(error).__name__}: {error}; check the fields' types") from error


def deserialize(payload: bytes, kind: str, distro: str = "jazzy") -> Message:
    """Return the message in a CDR payload; its arrays are read-only views of the payload.

    Raises:
        RosError: when the payload is no such message: truncated, too long, or not CDR.
    """
    try:
        return typestore(distro).deserialize_cdr(payload, kind)
    except (SerdeError, IndexError, OverflowError, MemoryError, AssertionError) as error:
        raise RosError(f"no {kind} in {len(payload)} bytes: {error}") from error


@functools.cache
def type_hash(kind: str, distro: str = "jazzy") -> str:
    """Return a type's hash as rmw_zenoh puts it into keys; humble's rmw has none and says so."""
    check_kind(kind, distro)
    return "TypeHashNotSupported" if distro == "humble" else typestore(distro).hash_rihs01(kind)


@functools.cache
def _makers(kind: str, distro: str) -> dict[str, tuple[Callable[[], Any], np.dtype[Any] | None]]:
    """Return for each field how its default is made, and the dtype where it is an array of numbers."""
    fields: list[tuple[str, Any]] = list(typestore(distro).fielddefs[kind][1])
    return {name: _maker(description, distro, DEFAULTS.get((kind, name), 0)) for name, description in fields}


def _maker(description: Any, distro: str, value: float) -> tuple[Callable[[], Any], np.dtype[Any] | None]:
    form, detail = description
    if form == Nodetype.NAME:
        return functools.partial(message, detail, distro), None
    if form == Nodetype.BASE:
        return functools.partial(_scalar, detail[0], value), None
    inner, length = detail
    count = length if form == Nodetype.ARRAY else 0
    if inner[0] == Nodetype.NAME or inner[1][0] == "string":
        return functools.partial(_repeat, _maker(inner, distro, 0)[0], count), None
    dtype = np.dtype(ALIASES.get(inner[1][0], inner[1][0]))
    return functools.partial(np.zeros, count, dtype), dtype


def _repeat(item: Callable[[], Any], count: int) -> list[Any]:
    return [item() for _ in range(count)]


def _scalar(base: str, value: float) -> Any:
    if base == "string":
        return ""
    if base == "bool":
        return bool(value)
    return float(value) if base.startswith("float") else int(value)


def _array(value: Any, dtype: np.dtype[Any], where: str) -> Any:
    try:
        return np.ascontiguousarray(value, dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise RosError(f"{where} must be numbers of {dtype}: {error}") from None
