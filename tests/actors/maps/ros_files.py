"""Maps of ROS, written for the tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

FREE, UNKNOWN, WALL = 254, 205, 0

DEFAULTS = {
    "resolution": 0.05,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def room(width: int = 60, height: int = 40) -> NDArray[np.uint8]:
    """Pixels of a walled room with unknown space around it, row 0 at the top."""
    pixels = np.full((height, width), UNKNOWN, dtype=np.uint8)
    pixels[5:-5, 5:-5] = WALL
    pixels[6:-6, 6:-6] = FREE
    return pixels


def write_ros(path: Path, pixels: NDArray[np.uint8] | None = None, image: str = "map.pgm", **fields) -> Path:
    """Write a YAML file and its image; fields that are None are left out."""
    Image.fromarray(room() if pixels is None else pixels).save(path.parent / image)
    values = {"image": image, **DEFAULTS, **fields}
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items() if value is not None))
    return path
