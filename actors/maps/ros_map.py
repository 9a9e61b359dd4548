"""Maps of ROS: the YAML file of map_server with its image, read as nav2_map_server reads them.

A pixel's shade is the mean of its channels, in trinary mode with the opacity as one more where the image has one. How
occupied it is, p, is 1 less the shade, or the shade itself with ``negate``. Then, by ``mode``:

- ``trinary``: p above ``occupied_thresh`` is occupied, p below ``free_thresh`` is free, the rest unknown;
- ``scale``: the same, with values from 0 to 100 between the thresholds; what is not wholly opaque is unknown;
- ``raw``: the shade from 0 to 255 is the value itself; above 100 is unknown.

The world's free cells are those of value 0 to `FREE_UP_TO`; what is unknown is not free. One thing is stricter than in
nav2: gray 205, which map_saver writes for unknown, is unknown in the first two modes even where ``free_thresh`` would
call it free, as the 0.25 does that nav2 writes by default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.maps.images import SAVED_UNKNOWN, Pixels, read_pixels
from actors.maps.placing import MAX_COORDINATE, Position, place
from actors.maps.turning import turn, turned_resolution
from common.errors import MapError
from common.system.extras import optional
from common.system.paths import is_file
from common.system.stand_ins import stand_in
from common.system.text_files import decode_text

Mode = Literal["trinary", "scale", "raw"]

FREE_UP_TO: Final = 25
"""Values of the occupancy up to here are free, as for the robot (`sensing.grid_free`)."""
UNKNOWN: Final = -1
OCCUPIED: Final = 100
LARGEST_FILE: Final = 65_536
LARGEST_NESTING: Final = 200
"""Bytes; a map's YAML has some two hundred."""
_LOSSY_TOLERANCE = 4


@dataclass(frozen=True, slots=True)
class MapServerFile:
    """What the YAML file of a map says.

    Attributes:
        image: path of the image.
        resolution: metres per pixel.
        origin: (x, y) of the lower left corner of the image, metres, map frame.
        yaw: direction of the image's rows in that frame, radians, counter-clockwise.
        negate: whether dark is free.
        occupied: `occupied_thresh`, 0 to 1.
        free: `free_thresh`, 0 to 1.
        mode: how shades become occupancy.
    """

    image: Path
    resolution: float
    origin: Position
    yaw: float
    negate: bool
    occupied: float
    free: float
    mode: Mode

    @property
    def cell(self) -> float:
        """Metres per cell of the world that it becomes."""
        return turned_resolution(self.resolution, self.yaw)


def names_image(path: Path) -> bool:
    """Whether a YAML file is that of a map; any other, such as parameters of nav2, names no image."""
    try:
        return "image" in _read(path)
    except MapError:
        return False


def read_map_server_file(path: Path) -> MapServerFile:
    """Read the YAML file of a map.

    Raises:
        MapError: it is missing, is no YAML in UTF-8, is too large, or a field is missing or wrong.
    """
    values = _read(path)
    needed = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    missing = [key for key in needed if key not in values]
    if missing:
        raise MapError(
            f"{path}: expected the YAML file of a ROS map, {', '.join(missing)} is missing: add it, or name the image "
            "itself with a start in metres"
        )
    image = values["image"]
    if not isinstance(image, str) or not image:
        raise MapError(f"{path}: expected image to be the name of a file, got {_shown(image)}: name the map's image")
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(
            f"{path}: expected origin to be [x, y, yaw] in metres and radians, got {_shown(origin)}: correct it"
        )
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    if max(abs(x), abs(y)) > MAX_COORDINATE:
        raise MapError(f"{path}: expected origin in metres of at most {MAX_COORDINATE:g}, got {origin}: correct it")
    if abs(yaw) > 4.0 * math.pi:
        raise MapError(f"{path}: expected the yaw of origin in radians, got {yaw:g}: is it in degrees? correct it")
    resolution = _number(path, "resolution", values["resolution"])
    if not 0.0 < resolution <= 10.0:
        raise MapError(f"{path}: expected resolution in metres per pixel, 0 to 10, got {resolution:g}: correct it")
    occupied, free = (_number(path, key, values[key]) for key in ("occupied_thresh", "free_thresh"))
    if not 0.0 <= free <= occupied <= 1.0:
        raise MapError(
            f"{path}: expected 0 <= free_thresh <= occupied_thresh <= 1, got {free:g} and {occupied:g}: correct them"
        )
    negate = values["negate"]
    if negate not in (0, 1):
        raise MapError(f"{path}: expected negate to be 0 or 1, got {_shown(negate)}: correct it")
    mode = values.get("mode", "trinary")
    mode = mode.lower() if isinstance(mode, str) else mode
    if mode not in ("trinary", "scale", "raw"):
        raise MapError(f"{path}: expected mode to be trinary, scale or raw, got {_shown(mode)}: correct it")
    return MapServerFile(
        image=path.parent / image,
        resolution=resolution,
        origin=(x, y),
        yaw=math.remainder(yaw, 2 * math.pi),
        negate=bool(negate),
        occupied=occupied,
        free=free,
        mode=cast(Mode, mode),
    )


def load_ros_map(
    path: Path,
    *,
    start: Position | None,
    target: Position | None = None,
    require_target: bool = False,
    name: str | None = None,
) -> GridMap:
    """Load a map of ROS.

    Args:
        path: its YAML file.
        start: (x, y) in the map frame, metres; such maps have no markers.
        target: likewise.
        require_target: whether a map without a target is an error (navigation).
        name: of the map; the YAML file's when not given.

    Returns:
        The map in its own frame. An origin with a yaw is turned as `actors.maps.turning` says.

    Raises:
        MapError: a file cannot be used, no start is given, or start or target are not in free space that can be
            reached.
    """
    file = read_map_server_file(path)
    if start is None:
        raise MapError(
            f"{path}: expected a start, a ROS map has none: give it in metres, --start X Y or {path.name}?start=X,Y"
        )
    if target is None and require_target:
        raise MapError(
            f"{path}: expected a target for navigation, a ROS map has none: give it in metres, --target X Y or "
            f"{path.name}?start=X,Y&target=X,Y, or choose the task exploration"
        )
    if not is_file(file.image):
        raise MapError(f"{path}: expected its image at {file.image}, there is no such file: correct the field image")
    values = occupancy(read_pixels(file.image), file)
    free = (values >= 0) & (values <= FREE_UP_TO)
    try:
        free, resolution, origin = turn(free, file.resolution, file.origin, file.yaw)
    except MapError as error:
        raise MapError(f"{path}: {error}") from None
    return place(path, path.name if name is None else name, free, resolution, origin, start, target)


def occupancy(pixels: Pixels, file: MapServerFile) -> NDArray[np.int8]:
    """Return how occupied each pixel is.

    Returns:
        -1 unknown, 0 free to 100 occupied, int8, shape (rows, columns), row 0 at the bottom.
    """
    channels = 4 if file.mode == "trinary" and pixels.has_alpha else 3
    # A table of all sums that channels can have: the same arithmetic as for each pixel, on a thousand of them.
    shades = np.arange(channels * 255 + 1) / (channels * 255)
    occupied = shades if file.negate else 1.0 - shades
    if file.mode == "raw":
        rounded = np.floor(shades * 255 + 0.5)
        table = np.where(rounded <= OCCUPIED, rounded, UNKNOWN)
    else:
        between: Any = UNKNOWN
        if file.mode == "scale":
            span = max(file.occupied - file.free, np.finfo(np.float64).tiny)
            between = np.rint(np.clip((occupied - file.free) / span, 0.0, 1.0) * OCCUPIED)
        table = np.where(occupied > file.occupied, OCCUPIED, np.where(occupied < file.free, 0, between))
    sums = pixels.colours[:, :channels].sum(axis=1, dtype=np.int32)
    values = table.astype(np.int8)[sums]
    if file.mode == "scale" and pixels.has_alpha:
        values[pixels.colours[:, 3] < 255] = UNKNOWN
    if file.mode != "raw" and not file.negate:
        near = _LOSSY_TOLERANCE if pixels.lossy else 0
        offsets = np.abs(pixels.colours[:, :3].astype(np.int16) - SAVED_UNKNOWN)
        values[(offsets <= near).all(axis=1) & (values == 0)] = UNKNOWN
    return pixels.spread(values)


def _read(path: Path) -> dict[Any, Any]:
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise MapError(f"{path}: expected the YAML file of a ROS map, got {size:,} bytes: name another file")
        data = path.read_bytes()
        if instead := stand_in(data):
            raise MapError(f"{path} {instead}")
        if data.count(b"[") + data.count(b"{") > LARGEST_NESTING:
            # The parser takes seconds to find that out.
            raise MapError(
                f"{path}: expected the YAML file of a ROS map, got something else (lists without end): name another"
            )
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such file: check the path") from None
    except OSError as error:
        raise MapError(f"{path}: cannot read it ({error.strerror}): check the file and its permissions") from error
    with optional("the YAML file of a ROS map", "actor"):
        import yaml

    try:
        text = decode_text(data)
    except ValueError as error:
        raise MapError(f"{path}: {error}") from None
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        _refuse_duplicates(path, node)
        values = None if node is None else loader.construct_document(node)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        problem = " ".join(str(error).split())[:200]
        raise MapError(
            f"{path}: expected the YAML file of a ROS map, got something else ({problem}): correct it or name another"
        ) from None
    if not isinstance(values, dict):
        got = "an empty file" if values is None else type(values).__name__
        raise MapError(f"{path}: expected the YAML file of a ROS map, got {got}: it has fields such as image")
    return values


def _refuse_duplicates(path: Path, node: Any) -> None:
    """Raise a MapError for a key that is there twice, of which YAML would take the last without a word."""
    seen: dict[str, int] = {}
    for key, _ in node.value if node is not None and node.id == "mapping" else ():
        line = key.start_mark.line + 1
        if key.id == "scalar" and seen.setdefault(key.value, line) != line:
            raise MapError(
                f"{path}: expected each key once, got {_shown(key.value)} in lines {seen[key.value]} and {line}: leave "
                "one out"
            )


def _number(path: Path, key: str, value: Any) -> float:
    # YAML 1.1 reads 1e-2 as a text, the parser of ROS as a number.
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise MapError(f"{path}: expected {key} to be a number, got {_shown(value)}: correct it")
    return number


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
