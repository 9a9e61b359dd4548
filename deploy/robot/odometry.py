"""Odometry that drifts: what wheels tell of a pose, and what corrects it."""

from __future__ import annotations

import math

import numpy as np

from common.geometry import Pose

_STREAM = 0x0D0


class Odometry:
    """Adds up the robot's small motions, each with an error.

    The scale of distances is wrong by a constant factor, drawn once; the heading walks randomly.
    """

    def __init__(self, start: Pose, drift: float, seed: int) -> None:
        """Begin at a pose, without error.

        Args:
            start: true pose.
            drift: standard deviation of the scale, and of the heading per square root of a metre, radians.
            seed: of the errors.
        """
        self._random = np.random.default_rng([_STREAM, seed])
        self._scale = 1.0 + drift * float(self._random.standard_normal())
        self._drift = drift
        self._truth = start
        self.pose = start

    def update(self, truth: Pose) -> Pose:
        """Take in the true pose a moment later and return the odometry's."""
        if self._drift == 0.0:
            self.pose = truth
            return truth
        ahead, left, turned = relative(self._truth, truth)
        distance = math.hypot(ahead, left)
        turned += self._drift * math.sqrt(distance) * float(self._random.standard_normal())
        self.pose = compose(self.pose, (self._scale * ahead, self._scale * left, turned))
        self._truth = truth
        return self.pose


def relative(base: Pose, other: Pose) -> tuple[float, float, float]:
    """Return (x, y, yaw) of a pose as seen from a base, metres and radians in [-pi, pi]."""
    dx, dy = other.x - base.x, other.y - base.y
    cosine, sine = math.cos(base.yaw), math.sin(base.yaw)
    return cosine * dx + sine * dy, cosine * dy - sine * dx, math.remainder(other.yaw - base.yaw, 2.0 * math.pi)


def compose(base: Pose, step: tuple[float, float, float]) -> Pose:
    """Return the pose that lies (x, y, yaw) from a base; undoes `relative`."""
    cosine, sine = math.cos(base.yaw), math.sin(base.yaw)
    x, y, yaw = step
    turned = math.remainder(base.yaw + yaw, 2.0 * math.pi)
    return Pose(base.x + cosine * x - sine * y, base.y + sine * x + cosine * y, turned)


def correction(truth: Pose, odometry: Pose) -> tuple[float, float, float]:
    """Return the transform map -> odom, (x, y, yaw), that puts an odometry pose where the robot truly is."""
    yaw = math.remainder(truth.yaw - odometry.yaw, 2.0 * math.pi)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return (
        truth.x - cosine * odometry.x + sine * odometry.y,
        truth.y - sine * odometry.x - cosine * odometry.y,
        yaw,
    )
