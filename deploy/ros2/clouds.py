"""Point clouds of any layout to arrays, and back."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, header, message, seconds
from deploy.ros2.scans import LONGEST_SWEEP

POINT_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Datatypes of sensor_msgs/PointField by number."""
TIME_FIELDS = frozenset({"t", "time", "timestamp", "time_stamp", "time_offset", "timeoffset", "offset_time"})
"""Names of the field that says when a point was measured."""
SHORTEST_SWEEP = 0.002
"""Lidars turn more slowly than this, seconds."""
_TIME_UNITS = (1.0, 1e-3, 1e-6, 1e-9)


def points_from(cloud: Message) -> NDArray[np.float32]:
    """Return the points of a PointCloud2: float32, shape (n, 3), or (n, 4) where it has an intensity.

    Points that are not finite are left out. Any field types, offsets, paddings and byte orders are read. The array may
    be a read-only view of the message.

    Raises:
        RosError: when x, y or z lacks, or the sizes do not fit the data.
    """
    fields = {field.name: field for field in cloud.fields}
    lacking = [name for name in ("x", "y", "z") if name not in fields]
    if lacking:
        raise RosError(f"a PointCloud2 needs the fields x, y and z; {', '.join(lacking)} lacks among {list(fields)}")
    names = ["x", "y", "z", *(["intensity"] if "intensity" in fields else [])]
    order = ">" if cloud.is_bigendian else "<"
    formats = []
    for name in names:
        code = POINT_TYPES.get(fields[name].datatype)
        if code is None:
            raise RosError(f"field {name} of a PointCloud2 has datatype {fields[name].datatype}, expected 1 to 8")
        formats.append(order + code)
    offsets = [fields[name].offset for name in names]
    data = np.ascontiguousarray(cloud.data, np.uint8)
    if cloud.height * cloud.width == 0:
        if len(data):
            raise RosError(f"a PointCloud2 of {cloud.height} x {cloud.width} points has {len(data)} bytes of data")
        return np.empty((0, len(names)), np.float32)
    ends = [offset + np.dtype(form).itemsize for offset, form in zip(offsets, formats, strict=True)]
    if max(ends) > cloud.point_step or cloud.row_step < cloud.width * cloud.point_step:
        raise RosError(
            f"a PointCloud2's fields must fit its point_step {cloud.point_step}, and {cloud.width} points its row_step "
            f"{cloud.row_step}"
        )
    starts = sorted(zip(offsets, ends, names, strict=True))
    for (_, end, name), (start, _, other) in itertools.pairwise(starts):
        if start < end:
            raise RosError(f"the fields {name} and {other} of a PointCloud2 overlap: correct their offsets")
    # The padding of the last row may be left out.
    least = cloud.row_step * (cloud.height - 1) + cloud.width * cloud.point_step
    if not least <= len(data) <= cloud.row_step * cloud.height:
        raise RosError(
            f"a PointCloud2 of {cloud.height} rows of {cloud.row_step} bytes must have {cloud.row_step * cloud.height} "
            f"bytes, got {len(data)}"
        )
    points: NDArray[np.float32]
    packed = formats == ["<f4"] * len(names) and offsets == list(range(0, 4 * len(names), 4))
    if packed and cloud.point_step == 4 * len(names) and cloud.row_step == cloud.width * cloud.point_step:
        points = data[: cloud.height * cloud.row_step].view(np.float32).reshape(-1, len(names))
    else:
        points = np.empty((cloud.height * cloud.width, len(names)), np.float32)
        grid = points.reshape(cloud.height, cloud.width, len(names))
        for column, (offset, form) in enumerate(zip(offsets, formats, strict=True)):
            grid[:, :, column] = _column(cloud, offset, form[1:])
    finite = np.isfinite(points[:, 0] + points[:, 1] + points[:, 2])
    return points if finite.all() else points[finite]


def times_from(cloud: Message, points: NDArray[np.float32]) -> NDArray[np.float64] | None:
    """Return when each of a cloud's points was measured, seconds after the cloud's stamp, shape (n,).

    Drivers call the field by several names, and count seconds or parts of them, from the stamp or from 1970. A sweep
    takes some hundredths of a second to one, which tells the unit.

    Args:
        cloud: a PointCloud2 that was read.
        points: what `points_from` returned for it.

    Returns:
        None where the cloud has no such field, or it tells nothing that could be true.
    """
    field = next((field for field in cloud.fields if field.name in TIME_FIELDS), None)
    code = None if field is None else POINT_TYPES.get(field.datatype)
    if field is None or code is None or len(points) < 2:
        return None
    if field.offset + np.dtype(code).itemsize > cloud.point_step:
        return None
    times = _column(cloud, field.offset, code).reshape(-1).astype(np.float64)
    if len(times) != len(points):
        offsets = [(one.offset, POINT_TYPES[one.datatype]) for one in cloud.fields if one.name in {"x", "y", "z"}]
        columns = [_column(cloud, *each).reshape(-1).astype(np.float32) for each in offsets]
        times = times[np.isfinite(sum(columns[1:], columns[0]))]
    first, last = float(times.min()), float(times.max())
    for unit in _TIME_UNITS:
        if SHORTEST_SWEEP <= (last - first) * unit <= LONGEST_SWEEP:
            stamp = seconds(cloud.header.stamp)
            for began in (0.0, stamp):
                if abs(first * unit - began) <= 2.0 * LONGEST_SWEEP:
                    return (times * unit) - began
    return None


def cloud_note(cloud: Message) -> str:
    """Return what is strange about a PointCloud2 that can be read all the same, one line; empty when nothing is."""
    used, sent = cloud.width * cloud.point_step, cloud.row_step * cloud.height
    if cloud.row_step - used >= cloud.point_step > 0:
        return (
            f"a PointCloud2 of {cloud.width} points of {cloud.point_step} bytes has a row_step of {cloud.row_step}, "
            "room for more of them: correct its width or row_step"
        )
    if len(cloud.data) != sent:
        return f"a PointCloud2 must have {sent} bytes by its row_step and height, got {len(cloud.data)}"
    return ""


def _column(cloud: Message, offset: int, form: str) -> NDArray[Any]:
    """Return one field of a PointCloud2, shape (height, width)."""
    data = np.ascontiguousarray(cloud.data, np.uint8)
    order = ">" if cloud.is_bigendian else "<"
    return np.ndarray((cloud.height, cloud.width), order + form, data.data, offset, (cloud.row_step, cloud.point_step))


def point_cloud(time: float, frame: str, points: NDArray[np.float32]) -> Message:
    """Build a PointCloud2 of float32 fields x, y, z and, for four columns, intensity.

    Args:
        time: stamp, seconds.
        frame: frame of the points.
        points: shape (n, 3) or (n, 4).
    """
    names = ("x", "y", "z", "intensity")[: points.shape[1]]
    data = np.ascontiguousarray(points, "<f4")
    return message(
        "sensor_msgs/msg/PointCloud2",
        header=header(time, frame),
        height=1,
        width=len(data),
        fields=[
            message("sensor_msgs/msg/PointField", name=name, offset=4 * number, datatype=7, count=1)
            for number, name in enumerate(names)
        ],
        point_step=4 * len(names),
        row_step=4 * len(names) * len(data),
        data=data.reshape(-1).view(np.uint8),
        is_dense=bool(np.isfinite(data).all()),
    )
