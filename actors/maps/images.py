"""Image files as pixels: PNG, PGM, JPG and BMP, with one clear sentence about those that cannot be used."""

from __future__ import annotations

import itertools
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import MapError
from common.system.extras import optional
from common.system.stand_ins import stand_in

if TYPE_CHECKING:
    from PIL import Image

T = TypeVar("T", bound=np.generic)

FORMATS = ("PNG", "PPM", "JPEG", "BMP")
SUFFIXES = frozenset({".png", ".pgm", ".ppm", ".pnm", ".jpg", ".jpeg", ".bmp"})
"""Of image files that may be maps, lower case."""
SAVED_UNKNOWN = 205
"""Gray that map_saver of ROS writes for unknown."""
# MPO is JPG with further pictures behind the first, as phones write it.
_LOSSY_FORMATS = ("JPEG", "MPO")
# Bytes, comments included; and a word of such a header, behind white space and comments.
_LONGEST_HEADER = 1 << 20
_WORD = re.compile(rb"(?:\s|#[^\r\n]*)*([^\s#]+)")
MAX_SIDE = 8192
"""Pixels; a header that announces more is refused before anything is unpacked."""


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """An image, unpacked: its colours, and which pixel has which.

    Gray and palette images have at most 256 colours, so what is worked out for each colour costs nothing. In all others
    every pixel counts as a colour of its own.

    Attributes:
        colours: red, green, blue and opacity, 0 to 255, uint8, shape (n, 4).
        indices: colour of each pixel, uint8, shape (rows, columns), row 0 the top one; None where the colours are those
            of the pixels, row by row.
        shape: (rows, columns).
        has_alpha: the file says how opaque its pixels are.
        lossy: the file's colours are near the true ones only (JPG).
    """

    colours: NDArray[np.uint8]
    indices: NDArray[np.uint8] | None
    shape: tuple[int, int]
    has_alpha: bool
    lossy: bool

    def spread(self, values: NDArray[T]) -> NDArray[T]:
        """Return values of the colours, shape (n,), as those of the map's cells, shape (rows, columns).

        Row 0 of the result is the bottom one.
        """
        pixels = values.reshape(self.shape) if self.indices is None else values[self.indices]
        return np.ascontiguousarray(pixels[::-1])


def read_pixels(path: Path) -> Pixels:
    """Read an image file.

    Images of 16 bits a channel are brought to 8, and PGM files whose white is not 255 to that, but for their gray 205:
    that is what map_saver writes for unknown, and tools that look for the brightest pixel put a white of 254 over it.
    Photographs are turned as their camera says.

    Raises:
        MapError: the file is missing, is no image of a known format, is too large or damaged.
        MissingPackageError: Pillow is not installed.
    """
    with optional("an image file", "actor"):
        from PIL import Image, ImageOps, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            opened = Image.open(path, formats=FORMATS)
        with opened:
            if max(opened.size) > MAX_SIDE:
                raise _too_large(path, f"{opened.width} x {opened.height}")
            has_alpha = opened.mode in ("RGBA", "LA", "PA") or "transparency" in opened.info
            lossy = opened.format in _LOSSY_FORMATS
            picture = _eight_bits(path, ImageOps.exif_transpose(opened) if lossy else opened)
            if picture.mode == "1":
                picture = picture.convert("L")
            few = picture.mode in ("L", "P")
            white = _white_of_pgm(path) if opened.format == "PPM" else 255
            indices = np.asarray(picture) if few else None
            colours = np.asarray((_all_colours(picture) if few else picture).convert("RGBA")).reshape(-1, 4)
            if SAVED_UNKNOWN < white < 255:
                colours = colours.copy()
                colours[(colours[:, :3] == round(SAVED_UNKNOWN * 255 / white)).all(axis=1), :3] = SAVED_UNKNOWN
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such file: check the path") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise _too_large(path, "many more") from None
    except UnidentifiedImageError:
        raise MapError(_no_image(path)) from None
    except (OSError, SyntaxError, ValueError, OverflowError) as error:
        raise MapError(f"{path}: cannot read the image ({error}): check the file and its permissions") from error
    return Pixels(colours, indices, (picture.height, picture.width), has_alpha, lossy)


def _too_large(path: Path, got: str) -> MapError:
    return MapError(
        f"{path}: expected an image of at most {MAX_SIDE} x {MAX_SIDE} px, got {got}: scale it down or crop it"
    )


def _no_image(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(1024)
    if instead := stand_in(head):
        return f"{path} {instead}"
    got = "something else: convert it" if head else "an empty file: copy it again"
    return f"{path}: expected an image (PNG, PGM, JPG or BMP), got {got}"


def _white_of_pgm(path: Path) -> int:
    """Return the value of white that the header of a PGM or PPM file gives; 255 for other files of that family."""
    with path.open("rb") as file:
        head = file.read(_LONGEST_HEADER)
    words = [found[1] for found in itertools.islice(_WORD.finditer(head), 4)]
    known = len(words) == 4 and words[0] in (b"P2", b"P3", b"P5", b"P6") and words[3].isdigit()
    return int(words[3]) if known else 255


def _eight_bits(path: Path, picture: Image.Image) -> Image.Image:
    if picture.mode == "F":
        raise MapError(f"{path}: expected 8 or 16 bits a pixel, got numbers with fractions: convert the image")
    if not picture.mode.startswith("I"):
        return picture
    values = np.asarray(picture, dtype=np.int64)
    if values.min() < 0 or values.max() > 0xFFFF:
        raise MapError(f"{path}: expected 8 or 16 bits a pixel, got values up to {values.max()}: convert the image")
    from PIL import Image

    # Tools make 16 bits of 8 by a shift, or so that white stays white.
    shifted = not (values & 0xFF).any()
    return Image.fromarray((values >> 8 if shifted else (values + 128) // 257).astype(np.uint8))


def _all_colours(picture: Image.Image) -> Image.Image:
    """Return an image of one row with each of the 256 colours that a gray or palette image can have."""
    from PIL import Image

    strip = Image.frombytes(picture.mode, (256, 1), bytes(range(256)))
    if picture.mode == "P":
        strip.putpalette(picture.getpalette("RGB") or [], "RGB")
    if "transparency" in picture.info:
        strip.info["transparency"] = picture.info["transparency"]
    return strip
