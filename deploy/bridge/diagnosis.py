"""Why a planner has nothing to offer, and whether that means that the task is done."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, OCCUPIED
from deploy.bridge.unseen import Unseen, confined, find_unseen


class Cause(StrEnum):
    """Why there is nowhere to go."""

    NO_MAP = "no_map"
    """Neither scan nor map has come, or none with a pose."""
    IN_OBSTACLE = "in_obstacle"
    """The robot's own cell is not free in the map."""
    NO_ROOM = "no_room"
    """The robot fits nowhere near its place by the map, or cannot get away from it."""
    COMPLETE = "complete"
    """Nothing unknown borders on space that the robot can reach."""
    LEFT_UNSEEN = "left_unseen"
    """Something does, but no reachable viewpoint observes it, or it was looked at in vain or given up."""


FINAL: Final = frozenset({Cause.COMPLETE, Cause.LEFT_UNSEEN})
"""Causes that end an exploration; with all others the robot waits and tries again."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Why there is nowhere to go.

    Attributes:
        cause: why.
        text: in words for the operator, with figures and what to do.
        unseen: what is left at the edge of what the robot can reach; None where nothing is.
    """

    cause: Cause
    text: str
    unseen: Unseen | None = None

    @property
    def final(self) -> bool:
        """Whether an exploration ends for it."""
        return self.cause in FINAL


def diagnose(mapper: Mapper | None, pose: Pose | None, config: MappingConfig) -> Diagnosis:
    """Say why no waypoint can be given.

    Args:
        mapper: updated at the pose; None while there is no map.
        pose: of the robot; None while there is none.
        config: of the mapper.
    """
    if mapper is None or pose is None or mapper.belief.known_cells == 0:
        lacking = "pose" if pose is None else "map"
        return Diagnosis(Cause.NO_MAP, f"no {lacking} yet: check the sensor topics")
    if mapper.stuck:
        value = mapper.belief.at(pose.position)
        here = f"({pose.x:.2f}, {pose.y:.2f}) by its map"
        if value != FREE:
            what = "inside an obstacle" if value == OCCUPIED else "in unknown space"
            return Diagnosis(
                Cause.IN_OBSTACLE,
                f"the robot stands {what} at {here}: check the localisation, the frames and driving.robot_radius, or "
                "`reset` the map",
            )
        return Diagnosis(
            Cause.NO_ROOM,
            f"a robot that needs {config.robot_radius:g} m of room fits nowhere near {here}: wait for more map, "
            "drive it into the open, or lower mapping.robot_radius",
        )
    unseen = find_unseen(mapper, config.robot_radius)
    if unseen is None and confined(mapper, pose, config.robot_radius):
        return Diagnosis(
            Cause.NO_ROOM,
            f"a robot that needs {config.robot_radius:g} m of room cannot leave ({pose.x:.2f}, {pose.y:.2f}), where by "
            "its map all around is too narrow: drive it into the open, or lower mapping.robot_radius or "
            "mapping.resolution",
        )
    if unseen is None:
        return Diagnosis(Cause.COMPLETE, "complete: no frontier is left at the edge of what the robot can reach")
    return Diagnosis(Cause.LEFT_UNSEEN, f"not complete: {unseen}", unseen)


def behind_closed_way(unseen: Unseen | None) -> Diagnosis | None:
    """Say that something closes the way to frontiers; None without any."""
    if unseen is None:
        return None
    x, y = unseen.position
    return Diagnosis(
        Cause.LEFT_UNSEEN,
        f"not complete: something that was not there before closes the way to {unseen.length:.1f} m of frontier around "
        f"({x:.1f}, {y:.1f}) m",
        unseen,
    )
