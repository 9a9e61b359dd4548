"""Packed results: written with xz, read from xz or gzip; equal results give equal bytes."""

from __future__ import annotations

import lzma
import zlib
from typing import Final, Protocol

SUFFIXES: Final = (".json.xz", ".json.gz")
"""How names of packed results end; the first is how they are written."""
# A packed file may unpack to so many bytes: ten times what a hundred episodes in large worlds take.
LARGEST: Final = 1 << 28
# Of the unpacking itself; what `xz -9` makes needs a quarter of it.
_MEMORY: Final = 1 << 28
_GZIP: Final = b"\x1f\x8b"
_XZ: Final = b"\xfd7zXZ\0"


class _Unpacking(Protocol):
    """What the decompressors of the standard library have in common."""

    @property
    def eof(self) -> bool: ...

    @property
    def unused_data(self) -> bytes: ...

    def decompress(self, data: bytes, max_length: int, /) -> bytes: ...


def pack(data: bytes) -> bytes:
    """Return the bytes of a file packed with xz."""
    return lzma.compress(data, preset=lzma.PRESET_DEFAULT | lzma.PRESET_EXTREME)


def unpack(data: bytes) -> bytes:
    """Return the bytes of a file, unpacked if it is packed.

    What it is tells the content and not the name: browsers unpack files and leave their names as they were.

    Raises:
        ValueError: it is damaged, or would be larger than `LARGEST`.
    """
    found, packed = b"", _packing(data)
    if packed is None:
        return data
    # Such files may be joined, and so do tools that pack in parallel.
    while packed is not None:
        name, unpacking = packed
        try:
            found += unpacking.decompress(data, LARGEST - len(found))
        except (zlib.error, lzma.LZMAError) as error:
            raise ValueError(f"it is no whole {name} file ({error})") from None
        if not unpacking.eof:
            raise ValueError(f"it is cut off, or unpacks to more than {LARGEST >> 20} MiB")
        data = unpacking.unused_data
        if data and len(found) >= LARGEST:
            raise ValueError(f"it unpacks to more than {LARGEST >> 20} MiB")
        packed = _packing(data)
    return found


def _packing(data: bytes) -> tuple[str, _Unpacking] | None:
    """Return what a file is packed with and how to unpack it, or None for what is not packed."""
    if data.startswith(_GZIP):
        return "gzip", zlib.decompressobj(wbits=16 + zlib.MAX_WBITS)
    if data.startswith(_XZ):
        return "xz", lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=_MEMORY)
    return None
