"""The configuration as text: TOML of a resolved one, and a Markdown reference of every setting."""

from __future__ import annotations

import inspect
import json
from collections.abc import Collection
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from common.config.run import RunConfig

_TYPE_NAMES: Final = {bool: "boolean", int: "integer", float: "number", str: "string", NoneType: "null"}

INTRODUCTION = """# Configuration

<!-- Made by `make docs` from the sections in common/config/: change the text there. -->

A run has one typed tree of settings. Each source overrides the ones before it:

1. the defaults below,
2. a preset, such as `--preset workstation` (small network, imitation first) or `paper` (sizes of the paper),
3. a TOML or JSON file: `--config run.toml`,
4. environment variables: `HD_LEARNER__BATCH_SIZE=32` sets `learner.batch_size`,
5. the command line: `--set learner.batch_size=32`, repeatable.

`hd-learner config` takes the same options and prints the resolved tree as TOML, which `--config` accepts.
An unknown setting or a value out of range is an error that names the setting, the source of the value and what was
expected. In a file, `"null"` unsets a setting. Only the learner is configured: actors fetch its resolved
configuration over the bus.
"""


def to_toml(config: BaseModel, left_out: Collection[str] = ()) -> str:
    """Write a resolved configuration as TOML that `ConfigTree.load` reads back to the same one.

    Args:
        config: resolved configuration.
        left_out: settings, as ``section.field``, that are written as comments, because their values follow from others.
    """

    def line(path: str, value: Any) -> str:
        return ("# " if path in left_out else "") + _toml_line(path.rpartition(".")[2], value)

    lines = [line(name, value) for name, value in _items(config) if not isinstance(value, BaseModel)]
    for name, value in _items(config):
        if isinstance(value, BaseModel):
            lines += ["", f"[{name}]", *(line(f"{name}.{key}", item) for key, item in _items(value))]
    return "\n".join(lines) + "\n"


def to_markdown(model: type[BaseModel] = RunConfig) -> str:
    """Write the reference of every setting of a tree: name, kind, default, meaning."""
    lines = ["| setting | type | default | meaning |", "| --- | --- | --- | --- |"]
    sections: list[str] = []
    for name, field in model.model_fields.items():
        annotation = field.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            # The field can have other defaults than the section by itself.
            defaults = field.get_default(call_default_factory=True)
            values = {key: getattr(defaults, key) for key in annotation.model_fields}
            sections += _section(name, annotation, values)
            continue
        lines.append(_row(name, field, field.get_default(call_default_factory=True)))
        for item in get_args(annotation):
            if isinstance(item, type) and issubclass(item, BaseModel):
                values = {key: each.get_default() for key, each in item.model_fields.items()}
                sections += _section(name, item, values)
    return "\n".join(lines + sections) + "\n"


def documentation() -> str:
    """Write docs/configuration.md."""
    return INTRODUCTION + "\n" + to_markdown()


def _section(name: str, model: type[BaseModel], defaults: dict[str, Any]) -> list[str]:
    """Return the lines of a section, or of one item of a list of sections."""
    head = ["", f"## `{name}`", "", inspect.cleandoc(model.__doc__ or ""), ""]
    rows = [_row(f"{name}.{key}", field, defaults[key]) for key, field in model.model_fields.items()]
    return [*head, "| setting | type | default | meaning |", "| --- | --- | --- | --- |", *rows]


def _items(model: BaseModel) -> list[tuple[str, Any]]:
    return [(name, getattr(model, name)) for name in type(model).model_fields]


def _toml_line(name: str, value: Any) -> str:
    if isinstance(value, dict):
        inner = ", ".join(f"{_toml_value(key)} = {_toml_value(item)}" for key, item in value.items())
        return f"{name} = {{{inner}}}"
    return f"{name} = {_toml_value('null' if value is None else value)}"


def _toml_value(value: Any) -> str:
    if isinstance(value, BaseModel):
        inner = ", ".join(f"{name} = {_toml_value(item)}" for name, item in _items(value) if item is not None)
        return f"{{{inner}}}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _row(name: str, field: FieldInfo, default: Any) -> str:
    shown = "null" if default is None else "required" if default is PydanticUndefined else json.dumps(default)
    meaning = " ".join((field.description or "").split()).replace("|", "\\|")
    return f"| `{name}` | {_kind(field)} | `{shown}` | {meaning} |"


def _kind(field: FieldInfo) -> str:
    return _type_name(field.annotation) + _bounds(field)


def _type_name(annotation: Any) -> str:
    """Return the words for a type: `number`, ``one of `a`, `b` ``, `list of strings or null`."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type_name(arguments[0])
    if origin is Literal:
        return "one of " + ", ".join(f"`{value}`" for value in arguments)
    if origin in (Union, UnionType):
        return " or ".join(_type_name(each) for each in arguments)
    if origin is tuple:
        return f"list of {_plural(arguments[0])}"
    if origin is dict:
        return f"table of {_plural(arguments[1])}"
    return _TYPE_NAMES[annotation]


def _plural(item: Any) -> str:
    if isinstance(item, type) and issubclass(item, BaseModel):
        return "tables"
    if get_origin(item) is tuple:
        return "points"
    if get_origin(item) is Literal:
        return "strings"
    return f"{_type_name(item)}s"


def _bounds(field: FieldInfo) -> str:
    parts = []
    for item in _constraints(field):
        if isinstance(item, Ge):
            parts.append(f"≥ {_number(item.ge)}")
        elif isinstance(item, Gt):
            parts.append(f"> {_number(item.gt)}")
        elif isinstance(item, Le):
            parts.append(f"≤ {_number(item.le)}")
        elif isinstance(item, Lt):
            parts.append(f"< {_number(item.lt)}")
    return f" {', '.join(parts)}" if parts else ""


def _number(bound: Any) -> str:
    return str(bound) if isinstance(bound, int) else f"{bound:g}"


def _constraints(field: FieldInfo) -> list[Any]:
    found: list[Any] = []
    for item in field.metadata:
        found += item.metadata if isinstance(item, FieldInfo) else [item]
    return found
