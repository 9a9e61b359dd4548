"""Settings that suit a set of worlds, so that nobody has to know them: ``worlds.toml`` files and shipped presets.

Both are parts of a run's configuration, in TOML. A ``worlds.toml`` lies in the folder of its maps; presets ship with
the package and are put before a path, as in ``floorplans:DIR``. Generators take the preset of their own name, and ROS
maps without a ``worlds.toml`` take `ROS_PRESET`. What a configuration file, the environment or the command line says
wins.

::

    [maps]
    metres_per_pixel = 0.1
    [mapping]
    resolution = 0.1
    [task]
    max_steps = "auto"        # by each set's worlds, see `actors.evaluation.step_limit`
    [worlds."plan.pgm"]       # start and target of files without markers, metres
    start = [1.5, 2.0]
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field, ValidationError

from common.config import Section
from common.config.load import resolve
from common.errors import ConfigError, MapError
from common.problems import first_problem
from common.system.documents import DocumentError, parse_toml, read_text

FILE_NAME: Final = "worlds.toml"
ROS_PRESET: Final = "floorplans"
AUTO: Final = "auto"
MAX_STEPS: Final = "task.max_steps"
SCALE: Final = "maps.metres_per_pixel"
_LARGEST_FILE = 1_048_576
_ALLOWED = (
    SCALE,
    "mapping.*",
    MAX_STEPS,
    "task.unseen_area",
    "task.arrival_radius",
    "simulator.sense_every",
    "simulator.rays",
    "simulator.range_noise",
)

_Point = tuple[Annotated[float, Field(allow_inf_nan=False)], Annotated[float, Field(allow_inf_nan=False)]]


class Places(Section):
    """Where the robot starts in a map, and where it must go; metres, map frame."""

    start: _Point | None = None
    target: _Point | None = None


@dataclass(frozen=True, slots=True)
class Recommendation:
    """What suits a set of worlds.

    Attributes:
        name: of the preset, or path of the file, that says so; empty where nothing does.
        settings: values by the setting's path, such as ``mapping.resolution``; `MAX_STEPS` may be `AUTO`.
        places: starts and targets by file, as paths below the set's folder.
    """

    name: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    places: Mapping[str, Places] = field(default_factory=dict)

    @property
    def metres_per_pixel(self) -> float | None:
        """Scale of its images."""
        return self.settings.get(SCALE)

    def without(self, path: str) -> Recommendation:
        """Return this one without a setting."""
        return replace(self, settings={key: value for key, value in self.settings.items() if key != path})

    def over(self, other: Recommendation) -> Recommendation:
        """Return this one with what only another says added."""
        name = " and ".join(each for each in (self.name, other.name) if each)
        return Recommendation(name, {**other.settings, **self.settings}, {**other.places, **self.places})


def preset_names() -> list[str]:
    """Return the names of the shipped presets."""
    return sorted(entry.name.removesuffix(".toml") for entry in _presets().iterdir() if entry.name.endswith(".toml"))


def read_preset(name: str) -> Recommendation:
    """Return the preset of a name that `preset_names` has."""
    return _parse(name, (_presets() / f"{name}.toml").read_text("utf-8"))


def read_folder(folder: Path) -> Recommendation:
    """Return what a folder's ``worlds.toml`` says, nothing where there is none.

    Raises:
        MapError: it cannot be read, or holds something that is no setting of worlds.
    """
    path = folder / FILE_NAME
    try:
        if not path.exists():
            return Recommendation()
        if path.stat().st_size > _LARGEST_FILE:
            raise MapError(f"{path}: expected settings of worlds, got more than {_LARGEST_FILE:,} bytes: shorten it")
        text = read_text(path)
    except (OSError, ValueError) as error:
        raise MapError(f"{path}: cannot read the settings of these worlds ({error}): correct or remove it") from None
    found = _parse(str(path), text)
    for file in found.places:
        if not (folder / file).is_file():
            near = difflib.get_close_matches(file, _names_below(folder), n=1)
            hint = f"did you mean {near[0]!r}?" if near else "correct the name"
            raise MapError(f"{path}: worlds.{json.dumps(file)}: there is no file {file!r} in this folder: {hint}")
    return found


def joined(recommendations: Sequence[Recommendation], explicit: Sequence[str]) -> dict[str, Any]:
    """Join what several sources recommend: of step limits the largest, a scale if they agree, anything else must agree.

    Args:
        recommendations: one for each source.
        explicit: settings that the user gives anyway, by path; about these sources may disagree.

    Returns:
        Values by the setting's path.

    Raises:
        ConfigError: two sources recommend different values, or one recommends a value and another none.
    """
    found: dict[str, Any] = {}
    for path in dict.fromkeys(path for each in recommendations for path in each.settings):
        values = [each.settings.get(path) for each in recommendations]
        agree = all(value == values[0] for value in values)
        if path in explicit or (path == SCALE and not agree):
            continue
        if path == MAX_STEPS:
            numbers = [value for value in values if isinstance(value, int)]
            found[path] = AUTO if AUTO in values else max(numbers)
        elif not agree:
            names = [each.name or "a source without settings" for each in recommendations]
            said = ", ".join(f"{name}: {value}" for name, value in zip(names, values, strict=True))
            raise ConfigError(
                f"these sources need different settings of {path} ({said}): evaluate them one by one, or give one "
                f"value with --set {path}=..."
            )
        else:
            found[path] = values[0]
    return found


def as_tree(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings by their paths as a tree of sections."""
    tree: dict[str, Any] = {}
    for path, value in settings.items():
        section, _, name = path.partition(".")
        tree.setdefault(section, {})[name] = value
    return tree


def _places(name: str, file: str, table: dict[str, Any]) -> Places:
    try:
        return Places.model_validate(table)
    except ValidationError as error:
        key = first_problem(error).path.partition(".")[0]
        known = key in Places.model_fields
        expected = "expected [x, y], two numbers in metres" if known else "unknown key, expected start or target"
        raise MapError(f"{name}: worlds.{json.dumps(file)}.{key}: {expected}, got {table[key]!r}: correct it") from None


def _names_below(folder: Path) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]


def _presets() -> Traversable:
    return resources.files("actors.maps") / "presets"


def _parse(name: str, text: str) -> Recommendation:
    try:
        tree = parse_toml(text)
    except DocumentError as error:
        raise MapError(f"{name}: expected settings of worlds in TOML, it is none ({error}): correct it") from None
    worlds = tree.pop("worlds", {})
    tables = {**tree, "worlds": worlds}
    if isinstance(worlds, dict):
        tables |= {f"worlds.{json.dumps(file)}": table for file, table in worlds.items()}
    for key, table in tables.items():
        if not isinstance(table, dict):
            raise MapError(
                f'{name}: {key}: expected tables such as [mapping] and [worlds."plan.pgm"], got a value, {table!r}: '
                "put it into its table"
            )
    settings = {f"{section}.{key}": value for section, table in tree.items() for key, value in table.items()}
    for path in settings:
        if path not in _ALLOWED and not path.startswith("mapping."):
            raise MapError(f"{name}: {path} is no setting of worlds: choose from {', '.join(_ALLOWED)}")
    try:
        plain = {path: value for path, value in settings.items() if (path, value) != (MAX_STEPS, AUTO)}
        checked = resolve(as_tree(plain))
    except ConfigError as error:
        raise MapError(f"{name}: {' '.join(str(error).split())}") from None
    places = {file: _places(name, file, place) for file, place in worlds.items()}
    # What the schema made of the values, so that 20 and 20.0 are the same.
    values = {path: getattr(getattr(checked, path.partition(".")[0]), path.partition(".")[2]) for path in plain}
    return Recommendation(name, {**settings, **values}, places)
