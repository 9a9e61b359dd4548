"""What a name of ROS may look like; `deploy.ros2.names` says which topic a name means."""

from __future__ import annotations

import re
from typing import Final

PRIVATE: Final = "~/"
"""Begins names below a node's own."""
_SEGMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def segments(text: str, what: str) -> list[str]:
    """Split a name at its slashes.

    Args:
        text: such as `/robot1/scan`; slashes at its ends are none of it.
        what: that it names, for the message.

    Raises:
        ValueError: a part is no ROS name: letters, digits and `_`, no digit in front. The message says what was
            expected, not what came.
    """
    parts = text.removeprefix("/").removesuffix("/").split("/")
    if not all(_SEGMENT.fullmatch(part) for part in parts):
        raise ValueError(f"a {what} is made of letters, digits and _ between slashes, such as /robot1/scan")
    return parts
