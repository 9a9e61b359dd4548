"""The configuration as text: TOML of a resolved one, and a Markdown reference of every setting."""

from __future__ import annotations

import inspect
import json
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from common.config.run import RunConfig

INTRODUCTION = """# Configuration

<!-- Made by `make docs` from the sections in common/config/: change the text there. -->

A run has one typed tree of settings. Each source overrides the ones before it:

1. the defaults below,
2. a preset: `hd-learner start --preset workstation` (small network, imitation first) or `paper` (the paper's sizes),
3. a TOML or JSON file: `--config run.toml`,
4. environment variables: `HD_LEARNER__BATCH_SIZE=32` is `learner.batch_size`,
5. the command line: `--set learner.batch_size=32`, as often as needed.

`hd-learner config` takes the same options and prints the resolved tree as TOML, which `--config` reads back.
Whatever is unknown or out of range ends the command with a line that names the setting, where its value came
from and what is expected. In a file, the text `"null"` stands for a setting that is not given. Actors fetch
the learner's resolved configuration over the bus: only the learner is configured.
"""


def to_toml(config: BaseModel) -> str:
    """Write a resolved configuration as TOML that `ConfigTree.load` reads back to the same one."""
    lines: list[str] = []
    plain = {name: value for name, value in _items(config) if not isinstance(value, BaseModel)}
    lines += [_toml_line(name, value) for name, value in plain.items()]
    for name, value in _items(config):
        if isinstance(value, BaseModel):
            lines += ["", f"[{name}]", *(_toml_line(key, item) for key, item in _items(value))]
    return "\n".join(lines) + "\n"


def to_markdown(model: type[BaseModel] = RunConfig) -> str:
    """Write the reference of every setting of a tree: name, kind, default, meaning."""
    lines = ["| setting | kind | default | meaning |", "| --- | --- | --- | --- |"]
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
    return [*head, "| setting | kind | default | meaning |", "| --- | --- | --- | --- |", *rows]


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
    shown = "not given" if default is None else "required" if default is PydanticUndefined else json.dumps(default)
    meaning = " ".join((field.description or "").split()).replace("|", "\\|")
    return f"| `{name}` | {_kind(field)} | `{shown}` | {meaning} |"


def _kind(field: FieldInfo) -> str:
    text = str(field.annotation)
    if any(isinstance(item, type) and issubclass(item, BaseModel) for item in get_args(field.annotation)):
        return "list of tables"
    if "Literal" in text and not text.startswith("tuple"):
        inner = text[text.index("[") + 1 : text.rindex("]")]
        return "one of " + ", ".join(f"`{part.strip().strip(chr(39))}`" for part in inner.split(","))
    names = {
        "int": "whole number",
        "float": "number",
        "bool": "true or false",
        "str": "text",
        "dict": "table of texts",
        "tuple[str": "list of texts",
        "tuple[typing.Literal": "list of texts",
        "tuple[float": "list of numbers",
        "tuple[tuple": "list of points",
    }
    kind = next((word for key, word in names.items() if text.removeprefix("<class '").startswith(key)), "")
    kind = kind or f"{_optional_kind(text)} or null"
    return kind + _bounds(field)


def _optional_kind(text: str) -> str:
    if "tuple" in text:
        return "list of numbers"
    return "number" if "float" in text else "text"


def _bounds(field: FieldInfo) -> str:
    parts = []
    for item in _constraints(field):
        if isinstance(item, Ge):
            parts.append(f"≥ {item.ge:g}")
        elif isinstance(item, Gt):
            parts.append(f"> {item.gt:g}")
        elif isinstance(item, Le):
            parts.append(f"≤ {item.le:g}")
        elif isinstance(item, Lt):
            parts.append(f"< {item.lt:g}")
    return f" {', '.join(parts)}" if parts else ""


def _constraints(field: FieldInfo) -> list[Any]:
    found: list[Any] = []
    for item in field.metadata:
        found += item.metadata if isinstance(item, FieldInfo) else [item]
    return found
