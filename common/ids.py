"""Names that become parts of bus keys and folder names."""

from __future__ import annotations

import re

ID_PATTERN = re.compile(r"[a-z0-9-]{1,64}")


def check_id(value: str, what: str) -> str:
    """Return a name that is safe as one part of a bus key; raise ValueError otherwise."""
    if not ID_PATTERN.fullmatch(value):
        raise ValueError(
            f"{what} must be 1 to 64 lower-case letters, digits and dashes, such as 'desk-1', got {value!r}"
        )
    return value
