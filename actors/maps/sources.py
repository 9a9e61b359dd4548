"""Sources of worlds: folders of PNG maps, generators, and mixtures of both.

A specification is one of

- ``FOLDER``: all PNG maps in it and its subfolders;
- ``FOLDER#train`` or ``FOLDER#validation``: nine tenths or one tenth of them, split by a hash of the file name, so that
  every machine splits alike and a file keeps its side when others come or go;
- ``generator:NAME`` or ``generator:NAME?key=value&key=value``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from actors.maps.generators import Generator, make_generator
from actors.maps.grid_map import GridMap
from actors.maps.png import list_png, load_png
from common.errors import MapError

Task = Literal["exploration", "navigation"]

GENERATOR_PREFIX = "generator:"
GENERATED_WORLDS = 1_000_000
"""Random draws take worlds 0 to this many from a generator: seeds further apart never meet."""
_SPLITS = ("train", "validation")


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

    def __len__(self) -> int:
        """Return the number of different worlds that `world` and `draw` can give."""
        ...

    def world(self, index: int) -> GridMap:
        """Return world number ``index``, 0 or more; the same on every machine. Numbers past the last begin anew."""
        ...

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Return a random world."""
        ...


class FolderSource:
    """PNG maps of a folder, in natural order of their names."""

    def __init__(self, spec: str, paths: Sequence[Path], metres_per_pixel: float, require_target: bool) -> None:
        self.name = spec
        self.paths = tuple(paths)
        self._metres_per_pixel = metres_per_pixel
        self._require_target = require_target

    def __len__(self) -> int:
        return len(self.paths)

    def world(self, index: int) -> GridMap:
        """Load map number ``index`` modulo the number of maps."""
        path = self.paths[index % len(self.paths)]
        return load_png(path, self._metres_per_pixel, require_target=self._require_target)

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Load a random map."""
        return self.world(int(rng.integers(len(self.paths))))


class GeneratorSource:
    """Worlds of one generator."""

    def __init__(self, spec: str, generator: Generator, metres_per_pixel: float) -> None:
        self.name = spec
        self.generator = generator
        self._metres_per_pixel = metres_per_pixel

    def __len__(self) -> int:
        return GENERATED_WORLDS

    def world(self, index: int) -> GridMap:
        """Draw world number ``index`` modulo the number of worlds."""
        return self.generator.world(index % GENERATED_WORLDS, self._metres_per_pixel)

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Draw a random world."""
        return self.world(int(rng.integers(GENERATED_WORLDS)))


class MixedSource:
    """Several sources, each with the same share whatever their sizes."""

    def __init__(self, sources: Sequence[MapSource]) -> None:
        self.name = " + ".join(source.name for source in sources)
        self.sources = tuple(sources)

    def __len__(self) -> int:
        return sum(len(source) for source in self.sources)

    def world(self, index: int) -> GridMap:
        """Return world ``index // k`` of source ``index % k`` of k sources."""
        return self.sources[index % len(self.sources)].world(index // len(self.sources))

    def draw(self, rng: np.random.Generator) -> GridMap:
        """Choose a source, then draw from it."""
        return self.sources[int(rng.integers(len(self.sources)))].draw(rng)


def open_sources(specs: Sequence[str], metres_per_pixel: float, task: Task) -> MapSource:
    """Open all sources of a configuration and try the first world of each.

    Args:
        specs: specifications, as the module's text describes them; at least one.
        metres_per_pixel: scale of PNG maps and of generated ones.
        task: navigation needs maps with a target; generated ones always have one.

    Returns:
        One source; several specifications are mixed evenly.

    Raises:
        MapError: a missing or empty folder, an unknown generator or parameter, or a first map that cannot be used.
    """
    if not specs:
        raise MapError("no source of maps is given: name a folder of PNG maps or a generator, such as generator:rooms")
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
    if isinstance(source, FolderSource):
        count = min(count, len(source))
        return [number * len(source) // count for number in range(count)]
    return list(range(count))


def in_validation(file_name: str) -> bool:
    """Whether a file belongs to the validation tenth of its folder."""
    digest = hashlib.sha256(file_name.encode()).digest()
    return int.from_bytes(digest[:8], "big") % 10 == 0


def _open(spec: str, metres_per_pixel: float, task: Task) -> MapSource:
    if spec.startswith(GENERATOR_PREFIX):
        name, _, query = spec.removeprefix(GENERATOR_PREFIX).partition("?")
        return GeneratorSource(spec, make_generator(name, _parameters(spec, query)), metres_per_pixel)
    return _open_folder(spec, metres_per_pixel, task)


def _parameters(spec: str, query: str) -> dict[str, str]:
    parameters: dict[str, str] = {}
    for pair in query.split("&") if query else []:
        key, equals, value = pair.partition("=")
        if not (key and equals and value):
            raise MapError(
                f"{spec}: expected key=value after '?', got '{pair}': write for example ?width=320&height=240"
            )
        if key in parameters:
            raise MapError(f"{spec}: parameter '{key}' is given twice: give it once")
        parameters[key] = value
    return parameters


def _open_folder(spec: str, metres_per_pixel: float, task: Task) -> FolderSource:
    text, mark, split = spec.rpartition("#")
    if not mark or Path(spec).expanduser().is_dir():
        text, split = spec, ""
    elif split not in _SPLITS:
        raise MapError(f"{spec}: unknown split '{split}': choose #train or #validation, or leave it out for all maps")
    folder = Path(text).expanduser()
    if not folder.is_dir():
        what = "is a file, expected a folder of PNG maps" if folder.is_file() else "there is no such folder"
        raise MapError(
            f"{spec}: {what}: use a generator such as generator:rooms, or fetch public maps as docs/maps.md says"
        )
    paths = list_png(folder)
    if not paths:
        raise MapError(f"{spec}: the folder holds no PNG maps: check the path or use a generator (generator:rooms)")
    if split:
        paths = [path for path in paths if in_validation(path.name) == (split == "validation")]
        if not paths:
            raise MapError(
                f"{spec}: no map of this folder falls into the split '{split}': use more maps or a folder of its own"
            )
    return FolderSource(spec, paths, metres_per_pixel, require_target=task == "navigation")
