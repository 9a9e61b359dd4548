"""Loading of the configuration: preset, file, environment, command line; the later one wins.

Every error names the setting, where its value came from, what was expected and, for a misspelt name, the nearest
known one.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from common.config.schema import RunConfig
from common.errors import ConfigError

ENVIRONMENT_PREFIX = "HD_"
# Variables with our prefix that are no settings of a run.
RESERVED_VARIABLES = frozenset({"HD_LOG_LEVEL", "HD_PROCESS_PREPARED"})

Source = tuple[str, str]  # where a value came from, and its raw text


def preset_names() -> list[str]:
    """Names of the presets that ship with the package."""
    folder = resources.files("common.config") / "presets"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_config(
    file: Path | None = None,
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    preset: str | None = None,
) -> RunConfig:
    """Resolve the configuration of a run.

    Args:
        file: TOML or JSON file with (part of) the tree.
        overrides: ``section.field=value`` texts of the command line.
        environment: variables such as ``HD_LEARNER__BATCH_SIZE=32``; none when not given.
        preset: name of a shipped preset that the file builds upon.

    Raises:
        ConfigError: for anything unknown, malformed or out of range; all problems are listed at once.
    """
    tree: dict[str, Any] = {}
    origin: dict[str, str] = {}
    if preset is not None:
        _merge(tree, _read_preset(preset), origin, f"preset {preset}")
    if file is not None:
        _merge(tree, _read_file(file), origin, f"file {file}")
    for path, raw, source in _environment_settings(environment or {}):
        _assign(tree, path, raw, origin, source)
    for path, raw in map(_split_override, overrides):
        _assign(tree, path, raw, origin, f"command line --set {path}")
    return resolve(tree, origin)


def resolve(tree: Mapping[str, Any], origin: Mapping[str, str] | None = None) -> RunConfig:
    """Validate a plain tree of settings, such as a run's spec; `origin` says where each value came from."""
    try:
        return RunConfig.model_validate(tree)
    except ValidationError as error:
        lines = [_explain(problem, origin or {}) for problem in error.errors(include_url=False)]
        raise ConfigError("configuration is not valid:\n" + "\n".join(f"  {line}" for line in lines)) from None


def field_at(path: str) -> FieldInfo | None:
    """Look a dotted path up in the schema; None when it names no field."""
    model: type[BaseModel] = RunConfig
    field: FieldInfo | None = None
    parts = path.split(".")
    for i, part in enumerate(parts):
        field = model.model_fields.get(part)
        if field is None:
            return None
        if i + 1 < len(parts):
            if not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
                return None
            model = field.annotation
    return field


def all_fields(model: type[BaseModel] = RunConfig, prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield every leaf of the tree as (dotted path, field)."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from all_fields(field.annotation, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", field


def _read_preset(name: str) -> dict[str, Any]:
    if name not in preset_names():
        raise ConfigError(f"unknown preset {name!r}: choose one of {', '.join(preset_names())}")
    text = (resources.files("common.config") / "presets" / f"{name}.toml").read_text("utf-8")
    return tomllib.loads(text)


def _read_file(file: Path) -> dict[str, Any]:
    try:
        text = file.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the configuration file {file}: {error}") from None
    try:
        tree = json.loads(text) if file.suffix == ".json" else tomllib.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise ConfigError(f"{file} is not valid {'JSON' if file.suffix == '.json' else 'TOML'}: {error}") from None
    if not isinstance(tree, dict):
        raise ConfigError(f"{file} must hold a table of settings, got a {type(tree).__name__}")
    return tree


def _merge(tree: dict[str, Any], other: Mapping[str, Any], origin: dict[str, str], source: str, path: str = "") -> None:
    for key, value in other.items():
        here = f"{path}{key}"
        if isinstance(value, Mapping) and isinstance(tree.setdefault(key, {}), dict):
            _merge(tree[key], value, origin, source, f"{here}.")
        else:
            field = field_at(here)
            # TOML knows no null, so its text stands for it where a setting may be null.
            nullable = field is not None and type(None) in get_args(field.annotation)
            tree[key] = None if nullable and value == "null" else value
            origin[here] = source


def _environment_settings(environment: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    for name in sorted(environment):
        if name.startswith(ENVIRONMENT_PREFIX) and name not in RESERVED_VARIABLES:
            path = name.removeprefix(ENVIRONMENT_PREFIX).lower().replace("__", ".")
            yield path, environment[name], f"environment variable {name}"


def _split_override(text: str) -> tuple[str, str]:
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise ConfigError(f"--set expects section.field=value, such as learner.batch_size=32, got {text!r}")
    return path.strip(), value.strip()


def _assign(tree: dict[str, Any], path: str, raw: str, origin: dict[str, str], source: str) -> None:
    field = field_at(path)
    if field is None:
        raise ConfigError(f"{source}: there is no setting {path!r}{_nearest(path)}")
    *sections, name = path.split(".")
    branch = tree
    for section in sections:
        branch = branch.setdefault(section, {})
    branch[name] = _parse(raw, field)
    origin[path] = source


def _parse(raw: str, field: FieldInfo) -> Any:
    """Turn a setting's text into a plain value; the schema has the last word on it."""
    kinds = {field.annotation, *get_args(field.annotation)}
    if type(None) in kinds and raw.lower() in {"null", "none", ""}:
        return None
    if get_origin(field.annotation) is tuple:
        if not raw.startswith("["):
            return [part.strip() for part in raw.split(",") if part.strip()]
        try:
            return json.loads(raw)
        except json.JSONDecodeError:
            return raw
    if kinds & {int, float, bool} or any(get_origin(kind) is not None for kind in kinds):
        try:
            return json.loads(raw)
        except json.JSONDecodeError:
            return raw
    choices = get_args(field.annotation)
    if choices and all(isinstance(choice, int) for choice in choices) and raw.isdigit():
        return int(raw)
    return raw


def _nearest(path: str) -> str:
    known = [name for name, _ in all_fields()]
    near = difflib.get_close_matches(path, known, n=1, cutoff=0.6)
    if not near:
        leaf = path.rsplit(".", 1)[-1]
        near = [name for name in known if name.rsplit(".", 1)[-1] == leaf][:1]
    return f": did you mean {near[0]!r}?" if near else "; `hd-learner config --describe` lists all"


def _explain(problem: Any, origin: Mapping[str, str]) -> str:
    path = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        source = origin.get(path)
        return f"{path}: there is no such setting{_nearest(path)}" + (f" (from {source})" if source else "")
    field = next((p for p in (path, path.rpartition(".")[0]) if p in origin), None)
    source = f" (from {origin[field]})" if field else ""
    message = problem["msg"].removeprefix("Value error, ")
    got = problem["input"]
    shown = f", got {got!r}" if not isinstance(got, (dict, BaseModel)) else ""
    return f"{path or 'run'}: {message[0].lower() + message[1:]}{shown}{source}"
