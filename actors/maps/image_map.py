"""Plain images as maps: with a yellow start and a red target painted in, or with both given in metres."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.maps.colours import NOT_FREE, START, TARGET, UNKNOWN, classify, gray_starts
from actors.maps.connectivity import label_regions
from actors.maps.grid_map import GridMap
from actors.maps.images import read_pixels
from actors.maps.placing import Position, place
from common.errors import MapError

START_MARKER = "start marker (yellow: hue 40 to 75 degrees)"
TARGET_MARKER = "target marker (red: hue within 20 degrees of 0)"
# Pieces of a marker that are smaller than this, in pixels, are what compression left beside it.
_LOSSY_PIECE = 12


def load_image(
    path: Path,
    metres_per_pixel: float = 0.25,
    *,
    start: Position | None = None,
    target: Position | None = None,
    require_target: bool = False,
    name: str | None = None,
) -> GridMap:
    """Load a map from an image; `actors.maps.colours` says what its pixels mean.

    Args:
        path: PNG, PGM, JPG or BMP.
        metres_per_pixel: scale of the image.
        start: (x, y) in metres from the lower left corner of the image; the marker's centre when not given. Markers
            are free space in any case.
        target: likewise.
        require_target: whether a map without a target is an error (navigation).
        name: of the map; the file's when not given.

    Returns:
        The map, its lower left corner at (0, 0). Start and target are given, or the centres of their markers.

    Raises:
        MapError: the file cannot be read, is no image or too large, lacks a marker, has several, has no free space, or
            has a start or target from which nothing can be reached.
    """
    pixels = read_pixels(path)
    classes = classify(pixels)
    free = (classes != NOT_FREE) & (classes != UNKNOWN)
    start_marker = None
    if start is None:
        start_marker = _marker(path, classes == START, START_MARKER, pixels.lossy)
        if start_marker is None and not pixels.lossy:
            start_marker = _one_square(gray_starts(pixels))
    target_marker = None if target is not None else _marker(path, classes == TARGET, TARGET_MARKER, pixels.lossy)
    if start_marker is not None:
        start = _centre(start_marker, metres_per_pixel)
    elif start is None:
        # Gray 205 is what the map saver of ROS writes for unknown.
        ros = "; this looks like the image of a ROS map: name its YAML file" if (classes == UNKNOWN).any() else ""
        raise MapError(
            f"{path}: expected one {START_MARKER}, found none: paint one on free space, or give the start in metres, "
            f"--start X Y or {path.name}?start=X,Y{ros}"
        )
    if target_marker is not None:
        target = _centre(target_marker, metres_per_pixel)
    elif target is None and require_target:
        raise MapError(
            f"{path}: expected one {TARGET_MARKER} for navigation, found none: use navigation maps or a generator, "
            f"give the target in metres, --target X Y or {path.name}?target=X,Y, or choose the task exploration"
        )
    name = path.name if name is None else name
    world = place(path, name, free, metres_per_pixel, (0.0, 0.0), start, target, start_marker)
    return replace(world, target_region=target_marker)


def _marker(path: Path, marker: NDArray[np.bool_], what: str, lossy: bool) -> NDArray[np.bool_] | None:
    """Return the one marker of a kind, bool, shape of the map; None without one."""
    rows = np.flatnonzero(marker.any(axis=1))
    if not len(rows):
        return None
    columns = np.flatnonzero(marker[rows[0] : rows[-1] + 1].any(axis=0))
    # A marker that fills its box is one square; anything else is looked at closely.
    box = marker[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    if box.all():
        return marker
    labels, count = label_regions(box)
    if lossy and count > 1:
        sizes = np.bincount(labels.ravel())[1:]
        kept = np.flatnonzero(sizes >= min(_LOSSY_PIECE, int(sizes.max()))) + 1
        box &= np.isin(labels, kept)
        count = len(kept)
    if count > 1:
        raise MapError(f"{path}: expected one {what}, found {count}: leave one and repaint the others as free")
    return marker


def _one_square(spots: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Return the one rectangle that is marked, None where nothing or anything else is: then the gray means nothing."""
    rows, columns = np.flatnonzero(spots.any(axis=1)), np.flatnonzero(spots.any(axis=0))
    if not len(rows) or not spots[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all():
        return None
    return spots


def _centre(marker: NDArray[np.bool_], metres_per_pixel: float) -> Position:
    """Return the centre of a marker's box, (x, y) in metres from the lower left corner."""
    rows, columns = np.flatnonzero(marker.any(axis=1)), np.flatnonzero(marker.any(axis=0))
    x, y = (int(columns[0]) + int(columns[-1]) + 1) / 2, (int(rows[0]) + int(rows[-1]) + 1) / 2
    return x * metres_per_pixel, y * metres_per_pixel
