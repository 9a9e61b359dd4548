"""Sources of worlds: folders of maps, single files, generators, and mixtures of them.

A specification is one of

- ``FOLDER``: all maps in it and its subfolders;
- ``FOLDER#train`` or ``FOLDER#validation``: nine tenths or one tenth of them, split by a hash of the file name, so that
  every machine splits alike and a file keeps its side when others come or go;
- ``FILE`` or ``FILE?start=X,Y&target=X,Y``: one image or ROS map;
- ``PRESET:FOLDER`` or ``PRESET:FILE``: the same with settings that suit it, see `actors.maps.recommended`;
- ``generator:NAME`` or ``generator:NAME?key=value&key=value``, where NAME may be MODULE:CLASS.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from actors.maps.files import MapFile, is_map_file, list_maps
from actors.maps.generators import Generator, make_generator
from actors.maps.grid_map import GridMap
from actors.maps.recommended import FILE_NAME, ROS_PRESET, SCALE, Recommendation, preset_names, read_folder, read_preset
from actors.maps.spec import MapSpec, parameters, parse_spec, place_text
from common.errors import MapError
from common.extensions import generator_name
from common.system.paths import exists
from common.tasks import find_task

DEFAULT_SCALE = 0.25
"""Metres per pixel of images, and of generated worlds, where nobody says otherwise."""
GENERATED_WORLDS = 1_000_000
"""Random draws take worlds 0 to this many from a generator: seeds further apart never meet."""


class MapSource(Protocol):
    """Worlds to train or to evaluate on.

    Usage::

        source = open_sources(["generator:rooms"], metres_per_pixel=0.25, task="exploration")
        world = source.draw(rng)
        validation = fixed_set(source, 50)
    """

    @property
    def name(self) -> str:
        """Specification that made it, for logs."""
        ...

    @property
    def scales(self) -> frozenset[float]:
        """Metres per cell that its worlds have."""
        ...

    def __len__(self) -> int:
        """Return the number of different worlds that `world` and `draw` can give."""
        ...

    def world(self, index: int) -> GridMap:
        """Return world number ``index``, 0 or more; the same on every machine. Numbers past the last begin anew."""
        ...

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Return a random world."""
        ...


class FileSource:
    """Maps in files, in natural order of their names.

    Attributes:
        name: specification that made it.
        files: the maps.
        scales: metres per cell that its worlds have.
    """

    def __init__(self, spec: str, files: Sequence[MapFile], metres_per_pixel: float, require_target: bool) -> None:
        self.name = spec
        self.files = tuple(files)
        self._metres_per_pixel = metres_per_pixel
        self._require_target = require_target
        self.scales = frozenset(file.scale(metres_per_pixel) for file in files)

    def __len__(self) -> int:
        return len(self.files)

    def world(self, index: int) -> GridMap:
        """Load map number ``index`` modulo the number of maps."""
        return self.files[index % len(self.files)].load(self._metres_per_pixel, self._require_target)

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Load a random map."""
        return self.world(int(rng.integers(len(self.files))))


class GeneratorSource:
    """Worlds of one generator."""

    def __init__(self, spec: str, generator: Generator, metres_per_pixel: float) -> None:
        self.name = spec
        self.scales = frozenset({metres_per_pixel})
        self.generator = generator
        self._metres_per_pixel = metres_per_pixel

    def __len__(self) -> int:
        return GENERATED_WORLDS

    def world(self, index: int) -> GridMap:
        """Draw world number ``index`` modulo the number of worlds."""
        return self.generator.world(index % GENERATED_WORLDS, self._metres_per_pixel)

    def name_of(self, index: int) -> str:
        """Return the name of world number ``index`` modulo the number of worlds, without drawing it."""
        return self.generator.name_of(index % GENERATED_WORLDS)

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Draw a random world."""
        return self.world(int(rng.integers(GENERATED_WORLDS)))


class MixedSource:
    """Several sources, each with the same share whatever their sizes."""

    def __init__(self, sources: Sequence[MapSource]) -> None:
        self.name = " + ".join(source.name for source in sources)
        self.sources = tuple(sources)
        self.scales = frozenset(scale for source in sources for scale in source.scales)

    def __len__(self) -> int:
        return sum(len(source) for source in self.sources)

    def world(self, index: int) -> GridMap:
        """Return world ``index // k`` of source ``index % k`` of k sources."""
        return self.sources[index % len(self.sources)].world(index // len(self.sources))

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Choose a source, then draw from it."""
        return self.sources[int(rng.integers(len(self.sources)))].draw(rng)


def open_sources(specs: Sequence[str], metres_per_pixel: float | None, task: str) -> MapSource:
    """Open all sources of a configuration and try the first world of each.

    Args:
        specs: specifications, as the module's text describes them; at least one.
        metres_per_pixel: scale of images and of generated worlds; when None that of their set, else `DEFAULT_SCALE`.
            What a specification itself says wins, and ROS maps have their own.
        task: name of the task; one with a target needs maps that have one, as generated ones do.

    Returns:
        One source; several specifications are mixed evenly.

    Raises:
        MapError: a missing file, a missing or empty folder, an unknown generator or parameter, or a first map that
            cannot be used.
    """
    if not specs:
        raise MapError("no source of maps is given: name a folder of maps, a file or a generator: generator:rooms")
    sources = [_open(spec, metres_per_pixel, task) for spec in specs]
    for source in sources:
        source.world(0)
    return sources[0] if len(sources) == 1 else MixedSource(sources)


def fixed_set(source: MapSource, count: int) -> list[GridMap]:
    """Choose worlds for validation: always the same ones, spread evenly over the source.

    Args:
        source: any source; a mixture gives the same number of each part, the first ones one more.
        count: worlds wanted, 1 or more.

    Returns:
        ``count`` worlds, or all of a folder that holds fewer.
    """
    return [source.world(number) for number in fixed_numbers(source, count)]


def fixed_numbers(source: MapSource, count: int) -> list[int]:
    """Return the numbers of the worlds of `fixed_set`, so that each can be loaded when its turn comes."""
    if isinstance(source, MixedSource):
        parts = len(source.sources)
        shares = [count // parts + (number < count % parts) for number in range(parts)]
        return [
            number * parts + place
            for place, (part, share) in enumerate(zip(source.sources, shares, strict=True))
            if share
            for number in fixed_numbers(part, share)
        ]
    if isinstance(source, FileSource):
        count = min(count, len(source))
        return [number * len(source) // count for number in range(count)]
    return list(range(count))


def in_validation(file_name: str) -> bool:
    """Whether a file belongs to the validation tenth of its folder."""
    digest = hashlib.sha256(file_name.encode()).digest()
    return int.from_bytes(digest[:8], "big") % 10 == 0


def recommended(spec: str) -> Recommendation:
    """Return the settings that suit a source: those of its preset, and of the ``worlds.toml`` beside its maps.

    Raises:
        MapError: there is no such source, or its settings cannot be read.
    """
    name = generator_name(spec)
    if name is not None:
        return read_preset(name) if name in preset_names() else Recommendation()
    parsed = parse_spec(spec)
    return _recommended(parsed, _files(parsed))


def _open(spec: str, metres_per_pixel: float | None, task: str) -> MapSource:
    name = generator_name(spec)
    if name is not None:
        query = spec.partition("?")[2]
        return GeneratorSource(spec, make_generator(name, parameters(spec, query)), metres_per_pixel or DEFAULT_SCALE)
    parsed = parse_spec(spec)
    files = _files(parsed)
    scale = parsed.metres_per_pixel or metres_per_pixel or _recommended(parsed, files).metres_per_pixel
    return FileSource(spec, files, scale or DEFAULT_SCALE, require_target=find_task(task).needs_target)


def _recommended(spec: MapSpec, files: Sequence[MapFile]) -> Recommendation:
    found = read_folder(_set_folder(spec))
    all_ros = all(file.is_ros for file in files)
    if spec.preset:
        found = read_preset(spec.preset).over(found)
    elif all_ros and not found.settings:
        found = read_preset(ROS_PRESET).over(found)
    return found.without(SCALE) if all_ros else found


def _set_folder(spec: MapSpec) -> Path:
    return spec.path if spec.path.is_dir() else spec.path.parent


def _files(spec: MapSpec) -> list[MapFile]:
    """Return the map files that a specification means; at least one."""
    if not exists(spec.path):
        raise MapError(
            f"{spec.text}: there is no such file, and no such folder: use a generator such as generator:rooms, or "
            "fetch public maps as docs/maps.md says"
        )
    if spec.path.is_dir():
        return _folder(spec)
    if not is_map_file(spec.path):
        raise MapError(
            f"{spec.text}: is a file, expected a map (PNG, PGM, JPG, BMP, or the YAML file of a ROS map) or a folder "
            "of maps: convert it"
        )
    if spec.split:
        raise MapError(f"{spec.text}: #{spec.split} splits the maps of a folder, got one file: leave it out")
    place = read_folder(_set_folder(spec)).places.get(spec.path.name)
    start = spec.start or (place.start if place else None)
    target = spec.target or (place.target if place else None)
    said = place_text(spec.start, spec.target)
    file = MapFile(spec.path, start, target, f"?{said}" if said else "", _set_folder(spec))
    if file.is_ros and spec.metres_per_pixel is not None:
        raise MapError(f"{spec.text}: a ROS map specifies its own resolution: leave metres_per_pixel out")
    return [file]


def _folder(spec: MapSpec) -> list[MapFile]:
    if spec.start or spec.target:
        raise MapError(
            f"{spec.text}: start and target apply to a single file, got a folder: give a file, or write {FILE_NAME} "
            "there"
        )
    files = list_maps(spec.path, dict(read_folder(spec.path).places))
    if not files:
        raise MapError(
            f"{spec.text}: the folder holds no PNG maps and no ROS maps: check the path or use a generator "
            "(generator:rooms)"
        )
    if spec.split:
        files = [file for file in files if in_validation(file.path.name) == (spec.split == "validation")]
        if not files:
            raise MapError(
                f"{spec.text}: no map of this folder falls into the split '{spec.split}': use more maps, or a "
                "separate folder"
            )
    return files
