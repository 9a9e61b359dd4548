"""Images of the public format, painted pixel by pixel for the tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

OCCUPIED = (127, 127, 127)
FREE = (195, 195, 195)
START = (255, 216, 0)
TARGET = (238, 22, 31)

Box = tuple[int, int, int, int]


def paint(path: Path, free: list[Box], markers: list[tuple[Box, tuple[int, int, int]]], size=(96, 64)) -> Path:
    """Write an image; boxes are (left, top, right, bottom) in pixels of the image."""
    pixels: NDArray[np.uint8] = np.empty((size[1], size[0], 3), dtype=np.uint8)
    pixels[:] = OCCUPIED
    for (left, top, right, bottom), colour in [*((box, FREE) for box in free), *markers]:
        pixels[top:bottom, left:right] = colour
    Image.fromarray(pixels).save(path)
    return path


def simple(path: Path, target: bool = True) -> Path:
    """A corridor from the start at the left to the target at the right."""
    markers = [((16, 16, 32, 32), START)] + ([((64, 16, 80, 32), TARGET)] if target else [])
    return paint(path, [(16, 16, 80, 32)], markers)
