"""Files that lie in the place of others: a pointer of Git LFS that was never resolved, a web page with an error."""

from __future__ import annotations

import re
from typing import Final

_POINTER: Final = b"version https://git-lfs.github.com/"
_PAGE: Final = re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:!doctype\s+html|html|head)\b", re.IGNORECASE)
_LOOKED_AT: Final = 1024


def stand_in(data: bytes) -> str:
    """Return what the bytes of a file are instead of what was wanted, and what to do; empty where nothing tells.

    The text fits behind the name of the file.
    """
    head = data[:_LOOKED_AT]
    if head.startswith(_POINTER):
        return "is a pointer of Git LFS and not the file itself: run `git lfs pull`, or download the file"
    if _PAGE.match(head):
        return "is a web page and not the file itself: download it again, by the address of the raw file"
    return ""
