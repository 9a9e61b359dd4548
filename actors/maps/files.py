"""Map files: which files of a folder are maps, and how one of any kind is loaded."""

from __future__ import annotations

import re
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path

import numpy as np

from actors.maps.colours import classify
from actors.maps.grid_map import GridMap
from actors.maps.image_map import load_image
from actors.maps.images import SUFFIXES, Pixels
from actors.maps.placing import Position
from actors.maps.recommended import FILE_NAME, Places
from actors.maps.ros_map import load_ros_map, names_image, read_map_server_file
from actors.maps.turning import turn
from common.errors import MapError

YAML_SUFFIXES = frozenset({".yaml", ".yml"})


@dataclass(frozen=True, slots=True)
class MapFile:
    """A file that holds a map.

    Attributes:
        path: an image, or the YAML file of a ROS map.
        start: (x, y), metres, map frame; None for that of the image's marker.
        target: likewise.
        suffix: what a name of the map has after that of its file, which tells two starts in one file apart.
        folder: of the set that it belongs to, whose ``worlds.toml`` may give its start and target.
    """

    path: Path
    start: Position | None = None
    target: Position | None = None
    suffix: str = ""
    folder: Path | None = None

    @property
    def is_ros(self) -> bool:
        """Whether it is a map of ROS, which has a scale of its own."""
        return self.path.suffix.lower() in YAML_SUFFIXES

    def scale(self, metres_per_pixel: float) -> float:
        """Return the metres per cell of the world, where images have so many metres per pixel.

        Raises:
            MapError: it is the YAML file of no map.
        """
        return read_map_server_file(self.path).cell if self.is_ros else metres_per_pixel

    def parts(self) -> list[Path]:
        """Return the files that make up the map: its own, and the image of a ROS map."""
        image = _image_of(self.path) if self.is_ros else None
        return [self.path] if image is None else [self.path, image]

    def changed_since(self, moment: float, *, replaced: bool) -> Path | None:
        """Return a file that the map depends on and that was written after a moment, if there is one.

        The ``worlds.toml`` of its folder is such a file: it may give start and target.

        Args:
            moment: seconds since 1970.
            replaced: whether an older file counts, too, that was put there after the moment, or touched.
        """
        for path in (*self.parts(), *([] if self.folder is None else [self.folder / FILE_NAME])):
            if path.is_file():
                status = path.stat()
                if status.st_mtime > moment or (replaced and status.st_ctime > moment):
                    return path
        return None

    def digest(self) -> str:
        """Return what identifies the contents of the map's files, with its start and target.

        Raises:
            OSError: a file cannot be read.
        """
        digest = blake2b(repr((self.start, self.target)).encode(), digest_size=8)
        for part in self.parts():
            data = part.read_bytes()
            digest.update(len(data).to_bytes(8, "little") + data)
        return digest.hexdigest()

    def load(self, metres_per_pixel: float, require_target: bool) -> GridMap:
        """Load the map.

        Args:
            metres_per_pixel: scale of images.
            require_target: whether a map without a target is an error.

        Raises:
            MapError: the file cannot be used.
        """
        name = self.path.name + self.suffix
        if self.is_ros:
            return load_ros_map(
                self.path, start=self.start, target=self.target, require_target=require_target, name=name
            )
        return load_image(
            self.path,
            metres_per_pixel,
            start=self.start,
            target=self.target,
            require_target=require_target,
            name=name,
        )


def is_map_file(path: Path) -> bool:
    """Whether a file's name says that it is a map."""
    return path.suffix.lower() in SUFFIXES | YAML_SUFFIXES


def list_maps(folder: Path, places: dict[str, Places] | None = None) -> list[MapFile]:
    """List the maps of a folder and its subfolders in natural order (``img_2`` before ``img_10``).

    These are all PNG files, all YAML files of ROS maps, and images of other kinds to which the folder's ``worlds.toml``
    gives a place. The image of a ROS map is no map of its own.

    Args:
        folder: an existing folder; hidden files and folders are left out.
        places: starts and targets by path below the folder.

    Returns:
        Maps; the order is the same on every machine.

    Raises:
        MapError: a place is that of no map, or a subfolder has settings of its own.
    """
    places = places or {}
    relative = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    visible = [path for path in relative if not any(part.startswith(".") for part in path.parts)]
    deeper = [path for path in visible if path.name == FILE_NAME and len(path.parts) > 1]
    if deeper:
        raise MapError(f"{folder}: {deeper[0]} applies only to its own folder: give that folder as a separate source")
    ros = [path for path in visible if path.suffix.lower() in YAML_SUFFIXES and names_image(folder / path)]
    images_of_ros = {_image_of(folder / path) for path in ros}
    images = [
        path
        for path in visible
        if (path.suffix.lower() == ".png" or (path.as_posix() in places and path.suffix.lower() in SUFFIXES))
        and (not images_of_ros or (folder / path).resolve() not in images_of_ros)
    ]
    found = sorted([*ros, *images], key=natural_key)
    missing = set(places) - {path.as_posix() for path in found}
    if missing:
        raise MapError(f"{folder / FILE_NAME}: there is no map {min(missing)!r} in this folder: correct the name")
    return [
        MapFile(folder / path, place.start, place.target, folder=folder)
        for path in found
        for place in [places.get(path.as_posix(), Places())]
    ]


def warm_up() -> None:
    """Compile all kernels that map files need, or load them from numba's cache, before processes start."""
    classify(Pixels(np.zeros((1, 4), dtype=np.uint8), None, (1, 1), has_alpha=False, lossy=False))
    turn(np.ones((1, 1), dtype=np.bool_), 1.0, (0.0, 0.0), 0.5)


def natural_key(path: Path) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Return a sorting key that compares the numbers inside a path as numbers."""
    text = path.as_posix()
    pieces = re.findall(r"([0-9]+)|([^0-9]+)", text)
    return tuple((0, int(digits), "") if digits else (1, 0, other) for digits, other in pieces), text


def _image_of(path: Path) -> Path | None:
    try:
        return read_map_server_file(path).image.resolve()
    except MapError:
        # It is told when the map itself is loaded.
        return None
