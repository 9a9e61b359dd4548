"""PyBullet's window and pictures: the camera follows the robot, real time, rendering without a display."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from actors.simulators.bullet import pybullet
from common.geometry import Pose

_SMOOTHING = 2  # pixels are rendered twice as fine and averaged


def follow_with_camera(client: int, pose: Pose, *, fresh: bool = False) -> None:
    """Aim the window's camera at the robot, and keep the distance and angle that the user chose."""
    distance, yaw, pitch = 14.0, 0.0, -60.0
    if not fresh:
        camera = pybullet.getDebugVisualizerCamera(physicsClientId=client)
        yaw, pitch, distance = camera[8], camera[9], camera[10]
    pybullet.resetDebugVisualizerCamera(distance, yaw, pitch, (pose.x, pose.y, 0.2), physicsClientId=client)


class RealTime:
    """Keeps simulated time from running ahead of the clock on the wall."""

    def __init__(self) -> None:
        self._simulated = 0.0
        self._started = time.monotonic()

    def advance(self, seconds: float) -> None:
        """Tell that so much simulated time has passed; sleeps when that was faster than real time."""
        self._simulated += seconds
        ahead = self._simulated - (time.monotonic() - self._started)
        if ahead > 0.0:
            time.sleep(ahead)
        elif ahead < -0.5:
            self._started, self._simulated = time.monotonic(), 0.0


def render(
    client: int,
    target: tuple[float, float, float],
    *,
    distance: float,
    yaw: float,
    pitch: float,
    size: tuple[int, int] = (960, 640),
    field_of_view: float = 50.0,
) -> NDArray[np.uint8]:
    """Render a picture with PyBullet's software renderer; no display is needed.

    Args:
        client: physics client of a simulator that was made with ``visible=True``.
        target: point to look at, metres.
        distance: from the camera to the target, metres.
        yaw: degrees, of the camera around the target.
        pitch: degrees; -90 looks straight down.
        size: width and height, pixels.
        field_of_view: degrees, vertical.

    Returns:
        RGB, uint8, shape (height, width, 3).
    """
    width, height = size[0] * _SMOOTHING, size[1] * _SMOOTHING
    view = pybullet.computeViewMatrixFromYawPitchRoll(target, distance, yaw, pitch, 0.0, 2)
    projection = pybullet.computeProjectionMatrixFOV(field_of_view, width / height, 0.05, 4.0 * distance + 50.0)
    image = pybullet.getCameraImage(
        width,
        height,
        view,
        projection,
        lightDirection=(-0.5, -0.9, 1.3),
        lightAmbientCoeff=0.62,
        lightDiffuseCoeff=0.5,
        lightSpecularCoeff=0.05,
        shadow=1,
        renderer=pybullet.ER_TINY_RENDERER,
        physicsClientId=client,
    )
    fine = np.asarray(image[2], dtype=np.uint8).reshape(size[1], _SMOOTHING, size[0], _SMOOTHING, 4)
    return fine[..., :3].mean(axis=(1, 3)).round().astype(np.uint8)
