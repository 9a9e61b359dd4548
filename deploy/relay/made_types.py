"""Message types for rclpy that no installed package has, made from their definitions at run time.

rclpy knows a type by its *type support*: a C structure with the type's names, its hash, its description, and functions
that turn it into bytes and back. The relay passes bytes on as they are, so those functions are never called: Fast DDS
needs the name, ROS 2 the hash and the description. The structures below are laid out as in the headers
`message_type_support_struct.h`, `type_hash.h` and `type_description/*__struct.h` of rosidl_runtime_c, and
`message_type_support.h` of rosidl_typesupport_fastrtps_cpp, which are the same in jazzy and kilted.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from ctypes import POINTER, Structure, addressof, c_char, c_char_p, c_size_t, c_uint8, c_uint64, c_void_p
from typing import Any, Final

from deploy.relay.descriptions import Description, OneType, describe

MIDDLEWARE: Final = "rmw_fastrtps_cpp"
"""The middleware that takes types made here."""
_IDENTIFIER: Final = b"rosidl_typesupport_fastrtps_c"
_RIHS01: Final = 1
_UNBOUNDED: Final = b"\0"

_Handle = ctypes.CFUNCTYPE(c_void_p, c_void_p, c_char_p)
_Getter = ctypes.CFUNCTYPE(c_void_p, c_void_p)
_MaxSize = ctypes.CFUNCTYPE(c_size_t, POINTER(c_char))


class _String(Structure):
    _fields_ = (("data", c_char_p), ("size", c_size_t), ("capacity", c_size_t))


class _Sequence(Structure):
    """A sequence of anything: all of rosidl's have the same layout."""

    _fields_ = (("data", c_void_p), ("size", c_size_t), ("capacity", c_size_t))


class _FieldType(Structure):
    _fields_ = (
        ("type_id", c_uint8),
        ("capacity", c_uint64),
        ("string_capacity", c_uint64),
        ("nested_type_name", _String),
    )


class _Field(Structure):
    _fields_ = (("name", _String), ("type", _FieldType), ("default_value", _String))


class _OneType(Structure):
    _fields_ = (("type_name", _String), ("fields", _Sequence))


class _Description(Structure):
    _fields_ = (("type_description", _OneType), ("referenced_type_descriptions", _Sequence))


class _Hash(Structure):
    _fields_ = (("version", c_uint8), ("value", c_uint8 * 32))


class _Callbacks(Structure):
    _fields_ = (
        ("message_namespace", c_char_p),
        ("message_name", c_char_p),
        ("cdr_serialize", c_void_p),
        ("cdr_deserialize", c_void_p),
        ("get_serialized_size", c_void_p),
        ("max_serialized_size", _MaxSize),
        ("key_callbacks", c_void_p),
    )


class _TypeSupport(Structure):
    _fields_ = (
        ("typesupport_identifier", c_char_p),
        ("data", c_void_p),
        ("func", _Handle),
        ("get_type_hash_func", _Getter),
        ("get_type_description_func", _Getter),
        ("get_type_description_sources_func", _Getter),
    )


# ROS 2 holds pointers to a type's parts for as long as it runs: whatever was made stays.
_MADE: Final[dict[tuple[str, str], type]] = {}
_ALIVE: Final[list[Any]] = []


def made_class(kind: str, distro: str) -> type:
    """Return a class that rclpy takes as a message type for raw publishers and raw subscriptions; never built.

    Args:
        kind: such as `tf2_msgs/msg/TFMessage`.
        distro: distribution whose definition is meant.

    Raises:
        RosError: the distribution does not define the type.
    """
    if (kind, distro) not in _MADE:
        _MADE[kind, distro] = _class_of(kind, _type_support(kind, describe(kind, distro)))
    return _MADE[kind, distro]


def forget_errors() -> None:
    """Forget the error that Fast DDS leaves in this thread when it looks for what describes a type to its own tools.

    It continues without; the next call of ROS 2 in the thread would complain about the error that was left.
    """
    with suppress(OSError):
        # Loaded already: by its name alone it is found wherever ROS 2 is.
        ctypes.CDLL("librcutils.so").rcutils_reset_error()


def _class_of(kind: str, support: _TypeSupport) -> type:
    new_capsule = ctypes.pythonapi.PyCapsule_New
    new_capsule.restype, new_capsule.argtypes = ctypes.py_object, (c_void_p, c_char_p, c_void_p)
    capsule = new_capsule(addressof(support), None, None)
    # rclpy looks for these in the class of the class, and asks of the others only whether they are there.
    names = ("_TYPE_SUPPORT", "_CREATE_ROS_MESSAGE", "_CONVERT_FROM_PY", "_CONVERT_TO_PY", "_DESTROY_ROS_MESSAGE")
    meta = type("MadeType", (type,), dict.fromkeys(names, capsule))
    made: type = meta(kind.rsplit("/", 1)[1], (), {"__doc__": f"{kind}, created from its definition."})
    return made


def _type_support(kind: str, description: Description) -> _TypeSupport:
    package, folder, name = kind.split("/")
    digest = bytes.fromhex(description.rihs01.removeprefix("RIHS01_"))
    hash_ = _kept(_Hash(_RIHS01, (c_uint8 * 32)(*digest)))
    described = _kept(
        _Description(
            _one_type(description.type_description),
            _sequence(_OneType, [_one_type(each) for each in description.referenced_type_descriptions]),
        )
    )
    # The text of the definition is no part of what is promised, and is left out.
    sources = _kept(_Sequence(None, 0, 0))
    callbacks = _kept(
        _Callbacks(
            f"{package}::{folder}".encode(), name.encode(), None, None, None, _kept(_MaxSize(_max_size)), None
        )
    )  # fmt: skip
    support = _kept(_TypeSupport())

    def handle(asked: int, identifier: bytes) -> int | None:
        del asked
        return addressof(support) if identifier == _IDENTIFIER else None

    def getter(part: Structure) -> Any:
        address = addressof(part)
        return _kept(_Getter(lambda _: address))

    support.typesupport_identifier = _IDENTIFIER
    support.data = addressof(callbacks)
    support.func = _kept(_Handle(handle))
    support.get_type_hash_func = getter(hash_)
    support.get_type_description_func = getter(described)
    support.get_type_description_sources_func = getter(sources)
    return support


def _one_type(one: OneType) -> _OneType:
    fields = [
        _Field(
            _string(each.name),
            _FieldType(
                each.type.type_id,
                each.type.capacity,
                each.type.string_capacity,
                _string(each.type.nested_type_name),
            ),
            _string(""),
        )
        for each in one.fields
    ]
    return _OneType(_string(one.type_name), _sequence(_Field, fields))


def _string(text: str) -> _String:
    data = _kept(text.encode())
    return _String(data, len(data), len(data) + 1)


def _sequence(kind: type[Structure], items: list[Any]) -> _Sequence:
    array = _kept((kind * len(items))(*items))
    return _Sequence(addressof(array) if items else None, len(items), len(items))


def _max_size(bounds: Any) -> int:
    bounds[0] = _UNBOUNDED
    return 0


def _kept(part: Any) -> Any:
    _ALIVE.append(part)
    return part
