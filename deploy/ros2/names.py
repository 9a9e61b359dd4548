"""Topic names: relative and absolute, namespaces, remapping."""

from __future__ import annotations

from collections.abc import Mapping

from deploy.ros2.errors import RosError
from deploy.ros_names import segments


def namespace(text: str) -> str:
    """Return a namespace in full: `robot1`, `/robot1` and `/robot1/` become `/robot1`, nothing becomes `/`.

    Raises:
        RosError: when a part of it is no ROS name.
    """
    return "/" + "/".join(_segments(text, "namespace")) if text.strip("/") else "/"


def topic_name(name: str, within: str = "/", remap: Mapping[str, str] | None = None) -> str:
    """Return the absolute name of a topic: below the namespace unless it begins with `/`, then remapped.

    Args:
        name: such as `/scan` or `scan`.
        within: namespace in full.
        remap: from names to names, both of which may be relative.

    Raises:
        RosError: when a part of the name is no ROS name: letters, digits and `_`, no digit in front.
    """
    full = _absolute(name, within)
    for old, new in (remap or {}).items():
        if _absolute(old, within) == full:
            return _absolute(new, within)
    return full


def _absolute(name: str, within: str) -> str:
    path = "/".join(_segments(name, "topic"))
    return f"/{path}" if name.startswith("/") or within == "/" else f"{within}/{path}"


def _segments(text: str, what: str) -> list[str]:
    try:
        return segments(text, what)
    except ValueError as error:
        raise RosError(f"{error}, got {text!r}: correct it") from None
