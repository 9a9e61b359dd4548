"""A tree of settings and how it is loaded: preset, file, environment, command line; the later one wins.

Every error names the setting, where its value came from, what was expected and, for a misspelt name, the nearest
known one.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from common.errors import ConfigError, HDError
from common.presets import names_in
from common.problems import Problem, problems
from common.registry import NamedPart
from common.system.documents import DocumentError, parse_json, parse_toml, read_text

M = TypeVar("M", bound=BaseModel)

_TABLE = "expected a table of settings"
# Variables beginning with HD_ that are settings of a process, of whatever kind, and not of a tree.
RESERVED_VARIABLES = frozenset({"HD_LOG_LEVEL", "HD_PAGE_TOKEN", "HD_PROCESS_PREPARED"})


@dataclass(frozen=True)
class ConfigTree(Generic[M]):
    """One kind of configuration: what it holds, and where its values may come from.

    Attributes:
        model: root of the tree.
        subject: whose configuration it is, for messages: ``run``.
        presets: folder of the shipped presets.
        preset_word: what a preset is called: ``preset``.
        prefix: of its environment variables.
        example: an override, for messages.
        command: prints the reference of all settings.
        names: yields what a configuration names: planners, simulators and the like, which must exist.
    """

    model: type[M]
    subject: str
    presets: Path
    preset_word: str
    prefix: str
    example: str
    command: str
    names: Callable[[M], Iterable[NamedPart]]

    def preset_names(self) -> list[str]:
        """Names of the presets that ship with the package."""
        return names_in(self.presets)

    def load(
        self,
        file: Path | None = None,
        overrides: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
        preset: str | None = None,
    ) -> M:
        """Resolve a configuration.

        Args:
            file: TOML or JSON file with (part of) the tree.
            overrides: ``section.field=value`` texts of the command line.
            environment: variables, such as ``HD_LEARNER__BATCH_SIZE=32`` for a run; none when not given.
            preset: name of a shipped preset that the file builds upon.

        Raises:
            ConfigError: for anything unknown, malformed or out of range; all problems are listed at once.
        """
        tree: dict[str, Any] = {}
        origin: dict[str, str] = {}
        if isinstance(overrides, str):
            raise ConfigError(f"settings: expected a list of texts, got the text {overrides!r}: write [{overrides!r}]")
        if preset is not None:
            self._merge(tree, self._read_preset(preset), origin, f"{self.preset_word} {preset}")
        if file is not None:
            self._merge(tree, _read_file(file), origin, f"file {file}")
        for path, raw, source in self._environment_settings(environment or {}):
            self._assign(tree, path, raw, origin, source)
        for path, raw in map(self._split_override, overrides):
            self._assign(tree, path, raw, origin, f"command line --set {path}")
        return self.resolve(tree, origin)

    def resolve(self, tree: Mapping[str, Any], origin: Mapping[str, str] | None = None) -> M:
        """Validate a plain tree of local settings; `origin` says where each value came from."""
        origin = origin or {}
        try:
            config = self.model.model_validate(tree)
        except ValidationError as error:
            raise _invalid(self._explain(problem, origin) for problem in problems(error)) from None
        unknown = [f"{path}: {text}{_source(path, origin)}" for path, text in _unknown(self.names(config))]
        if unknown:
            raise _invalid(unknown)
        return config

    def field_at(self, path: str) -> FieldInfo | None:
        """Look a dotted path up in the schema; None when it names no field."""
        model: type[BaseModel] = self.model
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

    def all_fields(self) -> Iterator[tuple[str, FieldInfo]]:
        """Yield every leaf of the tree as (dotted path, field)."""
        return _leaves(self.model, "")

    def _read_preset(self, name: str) -> dict[str, Any]:
        known = self.preset_names()
        if name not in known:
            raise ConfigError(f"unknown {self.preset_word} {name!r}: choose one of {', '.join(known)}")
        return tomllib.loads((self.presets / f"{name}.toml").read_text("utf-8"))

    def _merge(
        self, tree: dict[str, Any], other: Mapping[str, Any], origin: dict[str, str], source: str, path: str = ""
    ) -> None:
        for key, value in other.items():
            here = f"{path}{key}"
            if isinstance(value, Mapping) and isinstance(tree.setdefault(key, {}), dict):
                self._merge(tree[key], value, origin, source, f"{here}.")
            else:
                field = self.field_at(here)
                # TOML knows no null, so its text stands for it where a setting may be null.
                nullable = field is not None and type(None) in get_args(field.annotation)
                tree[key] = None if nullable and value == "null" else value
                origin[here] = source

    def _environment_settings(self, environment: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
        for name in sorted(environment):
            if name.startswith(self.prefix) and name not in RESERVED_VARIABLES:
                path = name.removeprefix(self.prefix).lower().replace("__", ".")
                yield path, environment[name], f"environment variable {name}"

    def _split_override(self, text: str) -> tuple[str, str]:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise ConfigError(f"--set expects section.field=value, such as {self.example}, got {text!r}")
        return path.strip(), value.strip()

    def _assign(self, tree: dict[str, Any], path: str, raw: str, origin: dict[str, str], source: str) -> None:
        field = self.field_at(path)
        if field is None:
            raise ConfigError(f"{source}: unknown setting {path!r}{self._nearest(path)}")
        *sections, name = path.split(".")
        branch = tree
        for depth, section in enumerate(sections, 1):
            branch = branch.setdefault(section, {})
            if not isinstance(branch, dict):
                here = ".".join(sections[:depth])
                raise ConfigError(f"{here}: {_TABLE}, got {branch!r}{_source(here, origin)}")
        branch[name] = _parse(raw, field)
        origin[path] = source

    def _nearest(self, path: str, *, table: bool = False) -> str:
        leaves = [name for name, _ in self.all_fields()]
        if path in leaves:
            section, _, leaf = path.rpartition(".")
            return f", a key with dots is one name: write {leaf!r} in the section {section!r}"
        sections = list(dict.fromkeys(name.rpartition(".")[0] for name in leaves if "." in name))
        known = sections if table else leaves
        near = difflib.get_close_matches(path.lower(), known, n=1, cutoff=0.6)
        if not near:
            leaf = path.rsplit(".", 1)[-1]
            near = [name for name in known if name.rsplit(".", 1)[-1] == leaf][:1]
        return f": did you mean {near[0]!r}?" if near else f"; `{self.command}` lists all"

    def _explain(self, problem: Problem, origin: Mapping[str, str]) -> str:
        path, got = problem.path, problem.given
        if problem.kind == "extra_forbidden":
            table = isinstance(got, Mapping)
            source = origin.get(path) or next((each for at, each in origin.items() if at.startswith(f"{path}.")), None)
            what = "section" if table else "setting"
            return f"{path}: unknown {what}{self._nearest(path, table=table)}" + (f" (from {source})" if source else "")
        source = _source(path, origin)
        message = _TABLE if problem.kind == "model_type" else problem.words
        shown = f", got {got!r}" if not isinstance(got, (dict, BaseModel)) else ""
        return f"{path or self.subject}: {message}{shown}{source}"


def _source(path: str, origin: Mapping[str, str]) -> str:
    field = next((p for p in (path, path.rpartition(".")[0]) if p in origin), None)
    return f" (from {origin[field]})" if field else ""


def _unknown(parts: Iterable[NamedPart]) -> Iterator[tuple[str, str]]:
    """Yield the names that do not exist, as path of the setting and what is wrong; nothing is imported."""
    for part in parts:
        try:
            part.registry.check(part.name)
        except HDError as error:
            yield part.path, str(error)


def _invalid(lines: Iterable[str]) -> ConfigError:
    return ConfigError("configuration is not valid:\n" + "\n".join(f"  {line}" for line in lines))


def _leaves(model: type[BaseModel], prefix: str) -> Iterator[tuple[str, FieldInfo]]:
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _leaves(field.annotation, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", field


def _read_file(file: Path) -> dict[str, Any]:
    try:
        text = read_text(file)
        tree = parse_json(text) if file.suffix.lower() == ".json" else parse_toml(text)
    except OSError as error:
        raise ConfigError(f"cannot read the configuration file {file}: {error}") from None
    except DocumentError as error:
        raise ConfigError(f"the configuration file {file} {error}") from None
    if not isinstance(tree, dict):
        raise ConfigError(f"{file} must hold a table of settings, got a {type(tree).__name__}")
    return tree


def _parse(raw: str, field: FieldInfo) -> Any:
    """Turn a setting's text into a plain value; the schema has the last word on it."""
    kinds = {field.annotation, *get_args(field.annotation)}
    if type(None) in kinds and raw.lower() in {"null", "none", ""}:
        return None
    if any(get_origin(kind) is tuple for kind in kinds):
        if not raw.startswith("["):
            return [part.strip() for part in raw.split(",") if part.strip()]
        try:
            return parse_json(raw)
        except DocumentError:
            return raw
    if kinds & {int, float, bool} or any(get_origin(kind) is not None for kind in kinds):
        try:
            return parse_json(raw)
        except DocumentError:
            return raw
    choices = get_args(field.annotation)
    if choices and all(isinstance(choice, int) for choice in choices) and raw.isdigit():
        return int(raw)
    return raw
