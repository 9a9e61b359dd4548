"""What the pixels of a plain image mean: free, not free, unknown, start marker, target marker.

The rule, for red R, green G, blue B from 0 to 255, chroma C = max(R, G, B) - min(R, G, B) and gray = luminance,
``0.2125 R + 0.7154 G + 0.0721 B``, truncated:

- yellow, C of at least 80 and a hue of 40 to 75 degrees: start marker, free;
- red, C of at least 80 and a hue within 20 degrees of 0: target marker, free; its blurred rim (C of at least 40, gray
  of at least 80) is free too;
- gray above 150: free, but for exactly 205, which is what ROS writes for unknown (in JPG files 201 to 209, colourless,
  and more than specks of it);
- anything else, and whatever is more transparent than opaque: not free.

Public maps that were converted to gray have lost their yellow: what it has become is told apart by `gray_starts`.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.maps.connectivity import label_regions
from actors.maps.images import SAVED_UNKNOWN, Pixels
from common.system.jit import njit

NOT_FREE: Final = 0
FREE: Final = 1
START: Final = 2
TARGET: Final = 3
UNKNOWN: Final = 4

_FREE_ABOVE: Final = 150
_MARKER_CHROMA: Final = 80
_RIM_CHROMA: Final = 40
_RIM_GRAY: Final = 80
_OPAQUE: Final = 128
# What the yellows of public maps become when an image is converted to gray, by one formula for luminance or another.
_GRAY_STARTS: Final = (204, 206, 207, 208, 209)
# JPG files move the gray of large areas by one or two, and tint them a little.
_LOSSY_TOLERANCE: Final = 4
_LOSSY_CHROMA: Final = 12
# Where they have an edge nearby, they leave specks; a block of their compression has so many pixels.
_LOSSY_SPECK: Final = 64


@njit(cache=True, nogil=True)
def _meaning(red: int, green: int, blue: int, tolerance: int, colourless: int) -> int:
    """Return the class of an opaque pixel."""
    # Whole numbers, because 127 must stay 127 and not become 126.99.
    gray = (2125 * red + 7154 * green + 721 * blue) // 10_000
    chroma = max(red, green, blue) - min(red, green, blue)
    if chroma >= _MARKER_CHROMA and blue <= min(red, green):
        # Hue is 60 (G - B) / C from red to yellow, and 120 - 60 (R - B) / C from yellow to green.
        if red >= green and 3 * (green - blue) >= 2 * chroma:
            return START
        if red < green and 4 * (red - blue) >= 3 * chroma:
            return START
    if chroma >= _RIM_CHROMA and red >= max(green, blue) and 3 * abs(green - blue) <= chroma:
        if chroma >= _MARKER_CHROMA:
            return TARGET
        if gray >= _RIM_GRAY:
            return FREE
    if chroma <= colourless and abs(gray - SAVED_UNKNOWN) <= tolerance:
        return UNKNOWN
    return FREE if gray > _FREE_ABOVE else NOT_FREE


@njit(cache=True, nogil=True)
def _classify(colours: NDArray[np.uint8], tolerance: int, colourless: int) -> NDArray[np.uint8]:
    classes = np.full(len(colours), NOT_FREE, dtype=np.uint8)
    for i in range(len(colours)):
        if colours[i, 3] >= _OPAQUE:
            red, green, blue = int(colours[i, 0]), int(colours[i, 1]), int(colours[i, 2])
            classes[i] = _meaning(red, green, blue, tolerance, colourless)
    return classes


def classify(pixels: Pixels) -> NDArray[np.uint8]:
    """Tell what each pixel means, by the rule in the module's text.

    Returns:
        `NOT_FREE`, `FREE`, `START`, `TARGET` or `UNKNOWN`, uint8, shape (rows, columns), row 0 at the bottom.
    """
    tolerance, colourless = (_LOSSY_TOLERANCE, _LOSSY_CHROMA) if pixels.lossy else (0, 0)
    classes = pixels.spread(_classify(pixels.colours, tolerance, colourless))
    if pixels.lossy:
        labels, count = label_regions(classes == UNKNOWN)
        specks = np.bincount(labels.ravel(), minlength=count + 1) < _LOSSY_SPECK
        specks[0] = False
        classes[specks[labels]] = FREE
    return classes


def gray_starts(pixels: Pixels) -> NDArray[np.bool_]:
    """Return which pixels have a gray that the yellow start of a public map becomes without its colour.

    Returns:
        bool, shape (rows, columns), row 0 at the bottom; nowhere true in an image that has colours.
    """
    red, green, blue, opacity = pixels.colours.T
    coloured = (red != green) | (red != blue)
    if pixels.spread(coloured & (opacity >= _OPAQUE)).any():
        return np.zeros(pixels.shape, dtype=np.bool_)
    return pixels.spread(np.isin(red, _GRAY_STARTS) & (opacity >= _OPAQUE))
