"""The worlds of an evaluation, each with a unique name and loaded when needed."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from actors.maps.files import MapFile
from actors.maps.grid_map import GridMap
from actors.maps.sources import FileSource, GeneratorSource, MapSource, MixedSource, fixed_numbers, open_sources
from common.errors import MapError

# How many worlds an evaluation takes from a source without an end, a generator, when no limit is given.
GENERATED_COUNT = 100


class WorldSet:
    """Worlds of one or more sources, always the same ones in the same order.

    A map of a file is named as that, with the start that its specification gives (`plan.yaml?start=1.5,2.0`); where
    several files of the source have the same name (the public benchmark has `img_1.png` three times), all are named
    with the folders that tell them apart, such as `easy/img_1.png`.

    Usage::

        worlds = WorldSet.open(["bench/"], "exploration", 0.25, limit=30)
        for number in worlds.numbers:
            world = worlds.load(number)

    Attributes:
        numbers: numbers of the worlds in their source; all that a worker needs to load one.
        metres_per_pixel: of every world, metres per cell.
    """

    def __init__(self, source: MapSource, limit: int | None) -> None:
        self._source = source
        endless = not _only_files(source)
        self.numbers = fixed_numbers(source, limit or (GENERATED_COUNT if endless else len(source)))
        if len(source.scales) > 1:
            scales = ", ".join(f"{scale:g}" for scale in sorted(source.scales))
            raise MapError(
                f"{source.name}: expected worlds of one scale, got {scales} metres per cell: evaluate them one by one"
            )
        (self.metres_per_pixel,) = source.scales
        paths = list(dict.fromkeys(file.path for file in _files(source)))
        self._root: Path | None = None
        if max(Counter(path.name for path in paths).values(), default=1) > 1:
            self._root = Path(os.path.commonpath([path.parent for path in paths]))
        names = Counter(self.name(number) for number in self.numbers)
        twice = next((name for name, count in names.items() if count > 1), None)
        if twice is not None:
            raise MapError(
                f"{source.name}: expected different worlds, got {twice!r} more than once: leave one source out, "
                "or give generators seeds that are further apart"
            )

    def changed_since(self, moment: float, digests: Mapping[int, str]) -> set[Path]:
        """Return files of worlds whose results were kept, for worlds that are others now.

        Only files that were written since are read, and only where it is known what they held.

        Args:
            moment: when the results were last written, seconds since 1970.
            digests: of the worlds with results, by number; an empty one where nothing is known but the moment.
        """
        found = set()
        for number, digest in digests.items():
            file = _file(self._source, number)
            written = None if file is None else file.changed_since(moment, replaced=bool(digest))
            if written is not None and not (digest and digest == self.digest(number)):
                found.add(written)
        return found

    def digest(self, number: int) -> str:
        """Return what identifies the contents of a world's files; empty for a generated one, and for a missing file."""
        file = _file(self._source, number)
        try:
            return "" if file is None else file.digest()
        except OSError:
            return ""

    @classmethod
    def open(cls, specs: Sequence[str], task: str, metres_per_pixel: float | None, limit: int | None) -> WorldSet:
        """Open sources as `actors.maps.sources` describes them, and try the first world of each.

        Args:
            specs: folders of maps, map files, or `generator:NAME[?key=value&...]`.
            task: its name; one with a target needs maps that have one.
            metres_per_pixel: scale of images and generated worlds; None for that of their set.
            limit: number of worlds, spread evenly over a folder; None for all of a folder, or 100 of a generator.

        Raises:
            MapError: a source cannot be used, worlds differ in their scale, or one is given more than once.
        """
        return cls(open_sources(specs, metres_per_pixel, task), limit)

    def __len__(self) -> int:
        return len(self.numbers)

    def load(self, number: int) -> GridMap:
        """Load the world of a number."""
        return self._source.world(number)

    def name(self, number: int) -> str:
        """Return the name of a world, which need not be loaded for that."""
        file = _file(self._source, number)
        if file is None:
            return _generated_name(self._source, number)
        path = file.path.name if self._root is None else file.path.relative_to(self._root).as_posix()
        return path + file.suffix

    def find(self, names: Sequence[str]) -> dict[str, int]:
        """Return the numbers of worlds by their names.

        Raises:
            MapError: a name is not among the worlds of this set.
        """
        known = {self.name(number): number for number in self.numbers}
        missing = [name for name in names if name not in known]
        if missing:
            raise MapError(
                f"{self._source.name} has no map {missing[0]!r} ({len(missing)} of {len(names)} are missing): give the "
                "same --maps (and --limit, for generators) that the results were made with"
            )
        return {name: known[name] for name in names}


def _only_files(source: MapSource) -> bool:
    if isinstance(source, MixedSource):
        return all(_only_files(part) for part in source.sources)
    return isinstance(source, FileSource)


def _files(source: MapSource) -> Iterator[MapFile]:
    if isinstance(source, MixedSource):
        for part in source.sources:
            yield from _files(part)
    elif isinstance(source, FileSource):
        yield from source.files


def _file(source: MapSource, number: int) -> MapFile | None:
    """Return the file of a world, None for a generated one."""
    if isinstance(source, MixedSource):
        parts = len(source.sources)
        return _file(source.sources[number % parts], number // parts)
    return source.files[number % len(source.files)] if isinstance(source, FileSource) else None


def _generated_name(source: MapSource, number: int) -> str:
    """Return the name of a generated world."""
    if isinstance(source, MixedSource):
        parts = len(source.sources)
        return _generated_name(source.sources[number % parts], number // parts)
    return source.name_of(number) if isinstance(source, GeneratorSource) else source.world(number).name
