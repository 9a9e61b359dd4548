"""visualization_msgs markers, for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from deploy.ros2.conversions import pose_message
from deploy.ros2.messages import Message, header, message, typestore

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity from 0 to 1."""

LINE_LIST, CUBE_LIST, SPHERE_LIST, TEXT = 5, 6, 7, 9
DELETE_ALL = 3


def spheres(
    time: float,
    frame: str,
    name: str,
    positions: NDArray[np.float64],
    diameter: float,
    colour: Colour,
    colours: Sequence[Colour] | None = None,
    z: float = 0.0,
) -> Message:
    """Build one marker of many spheres.

    Args:
        time: stamp, seconds.
        frame: frame of the positions.
        name: namespace of the marker, by which viewers switch it on and off.
        positions: shape (n, 2), metres.
        diameter: metres.
        colour: of all, unless `colours` gives each its own.
        colours: one per position.
        z: height, metres.
    """
    return _many(time, frame, name, SPHERE_LIST, positions, diameter, colour, colours, z)


def cubes(
    time: float, frame: str, name: str, positions: NDArray[np.float64], side: float, colour: Colour, z: float = 0.0
) -> Message:
    """Build one marker of many cubes, such as cells of a grid; side in metres."""
    return _many(time, frame, name, CUBE_LIST, positions, side, colour, None, z)


def lines(
    time: float,
    frame: str,
    name: str,
    segments: NDArray[np.float64],
    width: float,
    colour: Colour,
    colours: Sequence[Colour] | None = None,
    z: float = 0.0,
) -> Message:
    """Build one marker of many lines.

    Args:
        time: stamp, seconds.
        frame: frame of the ends.
        name: namespace of the marker.
        segments: shape (n, 2, 2): both ends of each line, metres.
        width: metres.
        colour: of all, unless `colours` gives each its own.
        colours: one per line.
        z: height, metres.
    """
    ends = np.asarray(segments, np.float64).reshape(-1, 2)
    each = None if colours is None else [colour for colour in colours for _ in range(2)]
    return _many(time, frame, name, LINE_LIST, ends, width, colour, each, z)


def text(
    time: float, frame: str, name: str, position: tuple[float, float], words: str, height: float, colour: Colour
) -> Message:
    """Build a marker with words that face the viewer; height in metres."""
    return _marker(time, frame, name, TEXT, height, colour, pose=pose_message(Pose(*position), height), text=words)


def markers(parts: Sequence[Message]) -> Message:
    """Build a MarkerArray; parts of the same name get different ids."""
    for number, part in enumerate(parts):
        part.id = number
    return message("visualization_msgs/msg/MarkerArray", markers=list(parts))


def clear(time: float, frame: str) -> Message:
    """Build the marker that makes viewers forget all earlier ones of the topic."""
    return message("visualization_msgs/msg/Marker", header=header(time, frame), action=DELETE_ALL)


def _many(
    time: float,
    frame: str,
    name: str,
    shape: int,
    positions: NDArray[np.float64],
    size: float,
    colour: Colour,
    colours: Sequence[Colour] | None,
    z: float,
) -> Message:
    # Thousands of points: the classes themselves, without the checks of `message`.
    types = typestore().types
    point, rgba = types["geometry_msgs/msg/Point"], types["std_msgs/msg/ColorRGBA"]
    points = [point(x, y, z) for x, y in np.asarray(positions, np.float64).reshape(-1, 2).tolist()]
    each = [] if colours is None else [rgba(*one) for one in colours]
    return _marker(time, frame, name, shape, size, colour, points=points, colors=each)


def _marker(time: float, frame: str, name: str, shape: int, size: float, colour: Colour, **fields: Any) -> Message:
    return message(
        "visualization_msgs/msg/Marker",
        header=header(time, frame),
        ns=name,
        type=shape,
        scale=message("geometry_msgs/msg/Vector3", x=size, y=size, z=size),
        color=_colour(colour),
        **fields,
    )


def _colour(colour: Colour) -> Message:
    r, g, b, a = colour
    return message("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a)
