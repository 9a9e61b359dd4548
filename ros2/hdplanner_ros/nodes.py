"""`ros2 run hdplanner_ros bridge` and `relay`: `hd-deploy` with the arguments that ROS 2 gives its nodes."""

import sys

from deploy.cli import main


def bridge() -> None:
    """Run the bridge."""
    _run("bridge")


def relay() -> None:
    """Run the relay between DDS and the bridge."""
    _run("relay")


def _run(command: str) -> None:
    sys.argv.insert(1, command)
    main()
