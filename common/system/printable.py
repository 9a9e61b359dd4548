"""Text from strangers on a terminal: nothing in it may move the cursor, change colours or pretend to be other text."""

from __future__ import annotations

import re
from typing import Any, Final

# Controls (C0, DEL, C1), the marks that turn the direction of text, lone surrogates, and what ends lines elsewhere.
_UNSAFE: Final = re.compile(
    "[\u0000-\u001f\u007f-\u009f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)
_UNSAFE_IN_LINES: Final = re.compile(_UNSAFE.pattern.replace("\u0000-\u001f", "\u0000-\u0008\u000b-\u001f"))


def is_printable(text: str) -> bool:
    """Whether text is one line without control characters."""
    return _UNSAFE.search(text) is None


def printable(text: str, *, lines: bool = False) -> str:
    r"""Replace what a terminal would obey by its escape, such as ``\x1b``.

    Args:
        text: of any origin.
        lines: leave line feeds and tabs, for text that is meant to have several lines.
    """
    return (_UNSAFE_IN_LINES if lines else _UNSAFE).sub(_escaped, text)


def printable_tree(value: Any) -> Any:
    """Return plain values as of JSON with every text in them, names included, made `printable`."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {printable_tree(name): printable_tree(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [printable_tree(inner) for inner in value]
    return value


def _escaped(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
