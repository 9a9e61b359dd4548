"""The public PNG format of exploration and navigation maps: read it and write it.

Gray is luminance, ``0.2125 R + 0.7154 G + 0.0721 B``, truncated. Above 150 is free, with the start marker (a yellow
square of 16 px) at 200 to 215; the target marker (red, 16 px) at 60 to 110 is free too; everything else is occupied.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from actors.maps.connectivity import label_regions, reachable
from actors.maps.grid_map import GridMap
from actors.maps.layout import BLOCK, lattice_origin
from common.errors import MapError

FREE_ABOVE = 150
START_GRAY = (200, 215)
TARGET_GRAY = (60, 110)
MIN_SIDE = 2 * BLOCK
MAX_SIDE = 8192

_OCCUPIED = (127, 127, 127)
_FREE = (195, 195, 195)
_START = (255, 217, 0)
_TARGET = (238, 22, 31)


def list_png(folder: Path) -> list[Path]:
    """List the PNG files of a folder and its subfolders in natural order (``img_2`` before ``img_10``).

    Args:
        folder: an existing folder; hidden files and folders are left out.

    Returns:
        Paths; the order is the same on every machine.
    """
    found = [path.relative_to(folder) for path in folder.rglob("*") if path.suffix.lower() == ".png" and path.is_file()]
    visible = [path for path in found if not any(part.startswith(".") for part in path.parts)]
    return [folder / path for path in sorted(visible, key=natural_key)]


def natural_key(path: Path) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Return a sorting key that compares the numbers inside a path as numbers."""
    text = path.as_posix()
    pieces = re.findall(r"([0-9]+)|([^0-9]+)", text)
    return tuple((0, int(digits), "") if digits else (1, 0, other) for digits, other in pieces), text


def load_png(path: Path, metres_per_pixel: float = 0.25, *, require_target: bool = False) -> GridMap:
    """Load a map in the public PNG format.

    Args:
        path: the file.
        metres_per_pixel: scale of the image.
        require_target: whether a map without a target marker is an error (navigation).

    Returns:
        The map, named as the file, its lower left corner at (0, 0). Start and target are the centres of their markers.

    Raises:
        MapError: the file cannot be read, is no image, has an impossible size, lacks a marker, has several, or has
            a start or target from which nothing can be reached.
    """
    gray = _read_gray(path)
    start_marker = (gray >= START_GRAY[0]) & (gray <= START_GRAY[1])
    target_marker = (gray >= TARGET_GRAY[0]) & (gray <= TARGET_GRAY[1])
    free = (gray > FREE_ABOVE) | target_marker
    start_at = _marker_centre(path, start_marker, "start marker (yellow, gray 200 to 215)")
    if start_at is None:
        raise MapError(
            f"{path}: expected one start marker (yellow, gray 200 to 215, {BLOCK} x {BLOCK} px), found none: "
            "paint one on free space"
        )
    target_at = _marker_centre(path, target_marker, "target marker (red, gray 60 to 110)")
    if target_at is None and require_target:
        raise MapError(
            f"{path}: expected one target marker (red, gray 60 to 110, {BLOCK} x {BLOCK} px) for navigation, found "
            "none: use navigation maps or a generator, or choose the task exploration"
        )
    _check_reachable(path, free, start_marker, target_marker)
    world = GridMap(
        name=path.name,
        free=free,
        resolution=metres_per_pixel,
        origin=(0.0, 0.0),
        start=(start_at[0] * metres_per_pixel, start_at[1] * metres_per_pixel),
        target=None if target_at is None else (target_at[0] * metres_per_pixel, target_at[1] * metres_per_pixel),
        target_region=None if target_at is None else target_marker,
        lattice_origin=lattice_origin(free.shape[0], metres_per_pixel),
    )
    for name, position in (("start", world.start), ("target", world.target)):
        if position is not None and not world.is_free(position):
            raise MapError(f"{path}: the centre of the {name} marker is not free: paint the marker as a full square")
    return world


def write_png(world: GridMap, path: Path) -> None:
    """Write a map in the public PNG format, so that it can be stored and shared.

    Reading it back with the same scale gives the same free space, start, target and marker, when start and target
    lie on corners of cells, as those of the generators do (else they move by up to half a cell).

    Args:
        world: the map; its origin and resolution are not part of the format.
        path: the file; its folder must exist.

    Raises:
        MapError: the file cannot be written.
    """
    rows, columns = world.free.shape
    image = np.zeros((rows, columns), dtype=np.uint8)
    image[world.free] = 1
    image[_square(world, world.start)] = 2
    if world.target is not None:
        region = world.target_region
        image[_square(world, world.target) if region is None else region & world.free] = 3
    picture = Image.fromarray(np.ascontiguousarray(image[::-1]), mode=None)
    picture.putpalette([value for colour in (_OCCUPIED, _FREE, _START, _TARGET) for value in colour])
    try:
        picture.save(path, format="PNG", optimize=True)
    except OSError as error:
        raise MapError(
            f"{path}: cannot write the map ({error.strerror or error}): check that the folder exists and is writable"
        ) from error


def _read_gray(path: Path) -> NDArray[np.uint8]:
    """Return the truncated luminance, uint8, shape (rows, columns), row 0 at the bottom."""
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            width, height = picture.size
            if not (MIN_SIDE <= width <= MAX_SIDE and MIN_SIDE <= height <= MAX_SIDE):
                raise MapError(
                    f"{path}: expected an image of {MIN_SIDE} to {MAX_SIDE} px on each side (the public maps have "
                    f"640 x 480), got {width} x {height}: scale or crop it"
                )
            pixels = np.asarray(picture.convert("RGB"), dtype=np.uint32)
    except UnidentifiedImageError as error:
        raise MapError(f"{path}: expected a PNG image, got something else: convert or remove it") from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise MapError(f"{path}: cannot read the map ({error}): check the file and its permissions") from error
    # Whole numbers, because 127 must stay 127 and not become 126.99.
    gray = (2125 * pixels[..., 0] + 7154 * pixels[..., 1] + 721 * pixels[..., 2]) // 10_000
    return np.ascontiguousarray(gray[::-1].astype(np.uint8))


def _marker_centre(path: Path, marker: NDArray[np.bool_], what: str) -> tuple[float, float] | None:
    """Return a marker's centre, (x, y) in cells from the lower left corner; None without a marker."""
    rows = np.flatnonzero(marker.any(axis=1))
    if not len(rows):
        return None
    bottom, top = int(rows[0]), int(rows[-1]) + 1
    columns = np.flatnonzero(marker[bottom:top].any(axis=0))
    left, right = int(columns[0]), int(columns[-1]) + 1
    # A marker that fills its box is one square; anything else is looked at closely.
    box = marker[bottom:top, left:right]
    if not box.all():
        count = label_regions(box)[1]
        if count > 1:
            raise MapError(f"{path}: expected one {what}, found {count}: leave one and repaint the others as free")
    return (left + right) / 2, (bottom + top) / 2


def _check_reachable(path: Path, free: NDArray[np.bool_], start: NDArray[np.bool_], target: NDArray[np.bool_]) -> None:
    first = np.unravel_index(int(np.argmax(start)), start.shape)
    region = reachable(free, (int(first[0]), int(first[1])))
    if not (region & ~start).any():
        raise MapError(f"{path}: the start is enclosed, no free space joins it: open a way out of the start marker")
    if target.any() and not (region & target).any():
        raise MapError(f"{path}: no free way leads from start to target: open one or move a marker")


def _square(world: GridMap, position: tuple[float, float]) -> NDArray[np.bool_]:
    """Return the largest square of free cells around a position, at most one block wide."""
    column = round((position[0] - world.origin[0]) / world.resolution)
    row = round((position[1] - world.origin[1]) / world.resolution)
    rows, columns = world.free.shape
    half = min(BLOCK // 2, row, column, rows - row, columns - column)
    while half > 1 and not world.free[row - half : row + half, column - half : column + half].all():
        half -= 1
    square = np.zeros(world.free.shape, dtype=np.bool_)
    square[row - half : row + half, column - half : column + half] = True
    return square & world.free
