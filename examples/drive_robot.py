"""Command a robot over the bus: start its task, watch it for a while, call it home.

``python examples/drive_robot.py tcp/192.168.1.5:7447`` commands the bridge of a robot that is there. Without an
endpoint a simulated robot and its bridge are started beside this program, with the extras `robot`, `actor` and
`pybullet`.
"""

import argparse
import time
from pathlib import Path

from common.bus.control import request
from deploy.network_config import guest_of
from deploy.profiles import load_deploy_config
from deploy.robot.deployment import Deployment
from deploy.ros2.session import open_session

WORLD = "generator:rooms?width=256&height=256&seed=5"
FAR = 3.0
"""Metres after which the robot is called home."""


def drive(endpoint: str) -> None:
    """Let a robot begin its task, and call it home after a few metres."""
    config = load_deploy_config(overrides=[f"ros.connect={endpoint}"])
    with open_session(guest_of(config.ros)) as session:
        # A bridge that has just been started prepares itself for a while, so the first command has patience.
        request(session, config.name, "start", 120.0, asked="robot")
        called = False
        while True:
            told = request(session, config.name, "status", asked="robot")
            print(f"{told['state']:10} {told['distance']:5.1f} m {told['explored_area']:5.0f} m2  {told['reason']}")
            if told["state"] in ("finished", "failed", "aborted"):
                return
            if told["distance"] > FAR and not called:
                request(session, config.name, "return_home", asked="robot")
                called = True
            time.sleep(0.5)


def main() -> None:
    """Drive the robot at the endpoint of the command line, or a simulated one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("endpoint", nargs="?", help="where the robot's bus listens, such as tcp/192.168.1.5:7447")
    endpoint = parser.parse_args().endpoint
    if endpoint is not None:
        drive(endpoint)
        return
    robot = ["--map", WORLD, "--speed-factor", "4"]
    with Deployment(load_deploy_config(), [], robot, ["--planner", "nearest"], Path("runs/example-robot")) as simulated:
        drive(simulated.endpoint)


if __name__ == "__main__":
    main()
