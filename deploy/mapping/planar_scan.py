"""A planar lidar's scan as beams from one place, although the robot moves while the lidar turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.geometry import Pose, Scan
from deploy.mapping.log_odds import Beams
from deploy.mapping.own_body import OwnBody
from deploy.tf.transform import Transform


def planar_scan(
    scan: Scan, places: Sequence[tuple[Transform, Transform]], range_min: float, range_max: float, body: OwnBody
) -> tuple[Beams, Pose]:
    """Return a scan's beams and the planar pose of its sensor, which may hang upside down.

    Beams that ended in the robot's own body tell nothing.

    Args:
        scan: as it came.
        places: the base in the map frame and the sensor on the base, at moments that are evenly spaced from the first
            beam to the last; one where all beams are of one moment. The beams are those of the middle one.
        range_min: metres.
        range_max: metres.
        body: outline of the robot.
    """
    beams = Beams.from_scan(scan, range_min, range_max)
    mount = places[len(places) // 2][1]
    if mount.matrix()[2, 2] < 0.0:
        beams = replace(beams, angles=-beams.angles)
    beams = _without_body(beams, mount.pose, body)
    poses = [_sensor_pose(base.pose, mount.pose) for base, mount in places]
    middle = poses[len(poses) // 2]
    return (beams if len(poses) == 1 else _at_rest(beams, poses, middle)), middle


def _sensor_pose(base: Pose, mount: Pose) -> Pose:
    sine, cosine = np.sin(base.yaw), np.cos(base.yaw)
    return Pose(
        float(base.x + cosine * mount.x - sine * mount.y),
        float(base.y + sine * mount.x + cosine * mount.y),
        base.yaw + mount.yaw,
    )


def _without_body(beams: Beams, mount: Pose, body: OwnBody) -> Beams:
    """Take out what ended within the robot's outline, seen from where the lidar sits on the base."""
    near = np.flatnonzero(beams.hits & (beams.ranges <= body.reach + np.hypot(mount.x, mount.y)))
    if len(near) == 0:
        return beams
    own = near[body.covers(Beams(beams.ranges[near], beams.hits[near], beams.angles[near]).ends(mount))]
    ranges, hits = beams.ranges.copy(), beams.hits.copy()
    ranges[own], hits[own] = np.nan, False
    return Beams(ranges, hits, beams.angles)


def _at_rest(beams: Beams, poses: Sequence[Pose], middle: Pose) -> Beams:
    """Return the beams as a lidar would have seen them from one place: each was sent from a pose of its own."""
    share = np.linspace(0.0, len(poses) - 1.0, len(beams.ranges))
    moments = np.arange(len(poses))
    yaw = np.interp(share, moments, np.unwrap([pose.yaw for pose in poses]))
    x = np.interp(share, moments, [pose.x - middle.x for pose in poses])
    y = np.interp(share, moments, [pose.y - middle.y for pose in poses])
    # The yaw of the middle is that of the unwrapped ones, to within whole turns, which directions do not show.
    angles = beams.angles + yaw - middle.yaw
    ranges = beams.ranges.astype(np.float64)
    x, y = x + ranges * np.cos(yaw + beams.angles), y + ranges * np.sin(yaw + beams.angles)
    # Where a beam without a return ends is no place that was measured: its direction counts alone.
    ranges = np.where(beams.hits, np.hypot(x, y), ranges)
    angles = np.where(beams.hits, np.arctan2(y, x) - middle.yaw, angles)
    return Beams(ranges.astype(np.float32), beams.hits, angles)
