"""What a message type is made of, in the words that ROS 2 hashes (REP 2011, RIHS01)."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any, Final

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import TIDMAP

from deploy.ros2.messages import check_kind, typestore

NESTED: Final = 1
"""Type id of a field that is a message itself."""
_ARRAY, _BOUNDED, _UNBOUNDED = 48, 96, 144
# ROS 2 gives a message without fields this one, because C structures cannot be empty.
_EMPTY: Final = ("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))


@dataclass(frozen=True, slots=True)
class FieldType:
    """Type of a field.

    Attributes:
        type_id: number of the type, plus 48 for arrays, 96 for bounded and 144 for unbounded sequences.
        capacity: of an array or a bounded sequence.
        string_capacity: of a bounded string.
        nested_type_name: of a message.
    """

    type_id: int
    capacity: int
    string_capacity: int
    nested_type_name: str


@dataclass(frozen=True, slots=True)
class Field:
    """A field: its name and type."""

    name: str
    type: FieldType


@dataclass(frozen=True, slots=True)
class OneType:
    """A type without those that it refers to."""

    type_name: str
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class Description:
    """A type, and those that it refers to in the order of their names."""

    type_description: OneType
    referenced_type_descriptions: tuple[OneType, ...]

    @property
    def rihs01(self) -> str:
        """The hash: that of the JSON, whose keys stand in the order of the attributes."""
        return f"RIHS01_{hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()}"


def describe(kind: str, distro: str) -> Description:
    """Describe a message type.

    Raises:
        RosError: the distribution does not define it.
    """
    check_kind(kind, distro)
    definitions = typestore(distro).fielddefs
    found: dict[str, OneType] = {}
    waiting = [kind]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = OneType(name, tuple(_field(*each) for each in definitions[name][1] or [_EMPTY]))
            waiting += [each.type.nested_type_name for each in found[name].fields if each.type.nested_type_name]
    return Description(found[kind], tuple(one for name, one in sorted(found.items()) if name != kind))


def _field(name: str, definition: Any) -> Field:
    form, detail = definition
    offset = capacity = 0
    if form in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        (form_of_item, detail), capacity = detail
        offset = _ARRAY if form == Nodetype.ARRAY else (_BOUNDED if capacity else _UNBOUNDED)
        form = form_of_item
    if form == Nodetype.NAME:
        return Field(name, FieldType(offset + NESTED, capacity, 0, detail))
    base, length = detail
    type_id = TIDMAP["bounded_string" if base == "string" and length else base]
    return Field(name, FieldType(offset + type_id, capacity, length if base == "string" else 0, ""))
