"""rclpy, and the message and service types that it is given."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any, Final

from deploy.relay.made_types import MIDDLEWARE, made_class
from deploy.ros2.errors import RosError

_ADVICE: Final = (
    "the relay joins ROS 2 by rclpy, which this Python does not have: source a ROS 2 installation "
    "(/opt/ros/DISTRO/setup.bash), or install the extra `ros2` (from a checkout: pip install -e '.[robot,ros2]')"
)


def load_rclpy() -> ModuleType:
    """Import rclpy.

    Raises:
        RosError: it is not installed, or cannot be loaded.
    """
    try:
        # Also where rclpy itself is there, and the library of its middleware or a part of it is not.
        return importlib.import_module("rclpy")
    except ImportError as error:
        raise RosError(f"{_ADVICE} ({error})") from error


def message_class(kind: str, distro: str) -> type:
    """Return what rclpy takes for a message type: the installed one, else one made from its definition.

    Raises:
        RosError: no package has it, and the middleware takes none that are made.
    """
    found = _installed(kind)
    if found is not None:
        return found
    middleware = importlib.import_module("rclpy.utilities").get_rmw_implementation_identifier()
    if middleware != MIDDLEWARE:
        package = kind.split("/", 1)[0]
        raise RosError(
            f"{kind} is not installed, and {middleware} takes no types made at run time: install the ROS 2 package "
            f"{package}, or set RMW_IMPLEMENTATION={MIDDLEWARE}"
        )
    return made_class(kind, distro)


def service_class(kind: str) -> Any | None:
    """Return the class of a service type; None where no installed package has it: services cannot be made."""
    return _installed(kind)


def _installed(kind: str) -> type | None:
    package, folder, name = kind.split("/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.{folder}"), name)
    except (ImportError, AttributeError):
        return None
    return found
