"""One transform between two frames: 3D rotation and translation."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import MappingError
from common.geometry import Pose

Vector = tuple[float, float, float]
# x, y, z, w as in geometry_msgs/Quaternion.
Quaternion = tuple[float, float, float, float]

# Frames farther from each other than this are a mistake, metres: UTM coordinates are less.
MAX_TRANSLATION: Final = 1e8
# A quaternion whose length is off by more than this is no rotation that was rounded, but a mistake.
LENGTH_TOLERANCE: Final = 0.1


@dataclass(frozen=True, slots=True)
class Transform:
    """Where a frame lies in another: a point p of the frame is R p + t in the other.

    Attributes:
        translation: t, metres.
        rotation: R as a unit quaternion (x, y, z, w).
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def checked(cls, translation: Vector, rotation: Quaternion) -> Transform:
        """Make a transform of foreign numbers and normalise its quaternion.

        Raises:
            MappingError: a number is not finite, or the quaternion is no rotation.
        """
        length = float(np.linalg.norm(rotation))
        # Written so that NaN is not within.
        if not (
            all(abs(number) <= MAX_TRANSLATION for number in translation) and abs(length - 1.0) <= LENGTH_TOLERANCE
        ):
            raise MappingError(
                f"a transform needs finite metres of at most {MAX_TRANSLATION:g} and a unit quaternion, got "
                f"translation {translation} and rotation {rotation}: correct its publisher"
            )
        x, y, z, w = rotation
        return cls(translation, (x / length, y / length, z / length, w / length))

    @classmethod
    def planar(cls, x: float, y: float, yaw: float, z: float = 0.0) -> Transform:
        """Make the transform of a planar pose."""
        return cls((x, y, z), (0.0, 0.0, float(np.sin(yaw / 2.0)), float(np.cos(yaw / 2.0))))

    def __matmul__(self, other: Transform) -> Transform:
        """Return this transform after the other: ``map_from_odom @ odom_from_base`` is ``map_from_base``."""
        x1, y1, z1, w1 = self.rotation
        x2, y2, z2, w2 = other.rotation
        x, y, z = self.apply(np.array([other.translation]))[0]
        return Transform(
            (float(x), float(y), float(z)),
            (
                w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
                w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
                w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
                w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            ),
        )

    def inverse(self) -> Transform:
        """Return the transform the other way."""
        x, y, z, w = self.rotation
        back = Transform((0.0, 0.0, 0.0), (-x, -y, -z, w))
        x, y, z = -back.apply(np.array([self.translation]))[0]
        return Transform((float(x), float(y), float(z)), back.rotation)

    def matrix(self) -> NDArray[np.float64]:
        """Return R, float64, shape (3, 3)."""
        x, y, z, w = self.rotation
        return np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the frame in the other frame, shape (n, 3)."""
        moved: NDArray[np.float64] = points @ self.matrix().T + np.array(self.translation)
        return moved

    @property
    def text(self) -> str:
        """Translation and quaternion, rounded for an operator."""
        return f"{tuple(round(n, 3) for n in self.translation)}, {tuple(round(n, 3) for n in self.rotation)}"

    @property
    def pose(self) -> Pose:
        """Position in the plane and heading of the frame's x axis."""
        rotation = self.matrix()
        return Pose(self.translation[0], self.translation[1], atan2(rotation[1, 0], rotation[0, 0]))


def interpolated(old: Transform, new: Transform, share: float) -> Transform:
    """Return the transform a share of the way from an old to a new one; rotations along the shorter arc (slerp)."""
    a, b = np.array(old.rotation), np.array(new.rotation)
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    angle = float(np.arccos(min(cosine, 1.0)))
    if angle < 1e-6:
        mixed = a + share * (b - a)
    else:
        mixed = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    x, y, z, w = (float(number) for number in mixed / np.linalg.norm(mixed))
    p, q = np.array(old.translation), np.array(new.translation)
    px, py, pz = (float(number) for number in p + share * (q - p))
    return Transform((px, py, pz), (x, y, z, w))


def differ(one: Transform, other: Transform) -> bool:
    """Whether two transforms differ by more than rounding: 5 mm, or some 0.01 radians."""
    cosine = abs(sum(a * b for a, b in zip(one.rotation, other.rotation, strict=True)))
    return max(abs(a - b) for a, b in zip(one.translation, other.translation, strict=True)) > 0.005 or cosine < 1 - 1e-5
