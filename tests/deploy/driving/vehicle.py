"""A round differential-drive robot whose wheels follow commands late, among circular and straight obstacles."""

import math

import numpy as np

from common.geometry import Pose
from deploy.config import DrivingConfig
from deploy.driving import Command, LocalPlanner

STEP = 0.01


class Vehicle:
    """Unicycle model with first-order lag of both velocities, in a world of points.

    Attributes:
        nearest: least distance of the centre to any obstacle point so far, metres.
    """

    def __init__(self, pose: Pose, world, lag: float = 0.1) -> None:
        self.pose, self.world, self.lag = pose, np.asarray(world, float).reshape(-1, 2), lag
        self.velocity = (0.0, 0.0)
        self.nearest = math.inf
        self.travelled = 0.0

    def drive(self, command: Command, seconds: float) -> None:
        gaps = np.hypot(self.world[:, 0] - self.pose.x, self.world[:, 1] - self.pose.y)
        close = self.world[gaps < 1.0]
        for _ in range(round(seconds / STEP)):
            follow = 1.0 - math.exp(-STEP / self.lag)
            v, w = self.velocity
            v, w = v + (command.linear - v) * follow, w + (command.angular - w) * follow
            self.velocity = v, w
            yaw = self.pose.yaw + w * STEP
            middle = self.pose.yaw + 0.5 * w * STEP
            self.pose = Pose(self.pose.x + v * math.cos(middle) * STEP, self.pose.y + v * math.sin(middle) * STEP, yaw)
            self.travelled += abs(v) * STEP
            if len(close):
                gaps = np.hypot(close[:, 0] - self.pose.x, close[:, 1] - self.pose.y)
                self.nearest = min(self.nearest, float(gaps.min()))

    def sees(self, reach: float = 4.0):
        gaps = np.hypot(self.world[:, 0] - self.pose.x, self.world[:, 1] - self.pose.y)
        return self.world[gaps < reach]


def run(vehicle: Vehicle, path, config: DrivingConfig, seconds: float = 60.0, until: float = 0.15, planner=None):
    """Drive until the goal is within `until` metres; return (reached, seconds, blocked, commands)."""
    planner = planner or LocalPlanner(config)
    dt = 1.0 / config.rate
    commands = []
    blocked = False
    for step in range(round(seconds / dt)):
        command = planner.command(vehicle.pose, vehicle.velocity, path, vehicle.sees(), dt)
        commands.append(command)
        blocked = blocked or command.blocked
        vehicle.drive(command, dt)
        if vehicle.pose.distance_to(path[-1]) < until:
            return True, step * dt, blocked, commands
    return False, seconds, blocked, commands


def wall(a, b, spacing: float = 0.03):
    """Points along a straight wall."""
    count = max(2, math.ceil(math.dist(a, b) / spacing))
    return np.linspace(a, b, count)


def pillar(x: float, y: float, radius: float, spacing: float = 0.04):
    """Points along a circle."""
    angles = np.arange(0.0, 2.0 * math.pi, min(spacing / radius, 1.0))
    return np.column_stack((x + radius * np.cos(angles), y + radius * np.sin(angles)))
