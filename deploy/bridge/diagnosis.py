"""Why a planner has nothing to offer, and whether that means that the task is done."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from common.config.schema import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.mapping.sight import FREE, OCCUPIED

# A free area of so many lattice cells should hold more than one reachable viewpoint.
_EXPECTED_CELLS: Final = 6.0


class Cause(StrEnum):
    """Why there is nowhere to go."""

    NO_MAP = "no_map"
    """Neither scan nor map has come, or none with a pose."""
    IN_OBSTACLE = "in_obstacle"
    """The robot's own cell is not free in the map."""
    SCALE = "scale"
    """The map is too small or too narrow for the distance between viewpoints."""
    CUT_OFF = "cut_off"
    """No viewpoint can be reached from the robot's place."""
    NO_FRONTIER = "no_frontier"
    """Nothing unknown borders on known free space: all is explored."""
    UNREACHABLE = "unreachable"
    """Frontiers are left, but none that a reachable viewpoint observes."""


FINAL: Final = frozenset({Cause.NO_FRONTIER, Cause.UNREACHABLE})
"""Causes that end an exploration; with all others the robot waits and tries again."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Why there is nowhere to go.

    Attributes:
        cause: why.
        text: in words for the operator, with figures and what to do.
    """

    cause: Cause
    text: str

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
        return Diagnosis(Cause.NO_MAP, f"there is no {lacking} yet: check the topics of the sensors")
    value = mapper.belief.at(pose.position)
    if mapper.stuck and value != FREE:
        what = "inside an obstacle" if value == OCCUPIED else "in unknown space"
        return Diagnosis(
            Cause.IN_OBSTACLE,
            f"the robot stands {what} at ({pose.x:.2f}, {pose.y:.2f}) by its map: check the localisation, the frames "
            "and driving.robot_radius, or `reset` the map",
        )
    frontiers = len(mapper.frontiers)
    viewpoints = len(mapper.viewpoints)
    spacing = config.viewpoint_spacing
    if viewpoints <= 1 and frontiers:
        area = mapper.explored_area
        if area < _EXPECTED_CELLS * spacing**2:
            return Diagnosis(
                Cause.SCALE,
                f"{area:.1f} m2 of free map hold {viewpoints} reachable viewpoints at a spacing of {spacing:g} m: wait "
                "for more map, or lower mapping.viewpoint_spacing",
            )
        return Diagnosis(
            Cause.CUT_OFF,
            f"none of the viewpoints, {spacing:g} m apart, can be reached in a straight free line from "
            f"({pose.x:.2f}, {pose.y:.2f}): passages may be too narrow for mapping.viewpoint_spacing",
        )
    if not frontiers:
        return Diagnosis(Cause.NO_FRONTIER, "no frontier is left: everything that can be seen from here is known")
    return Diagnosis(
        Cause.UNREACHABLE,
        f"{frontiers} frontier cells are left that no reachable viewpoint observes, or that were looked at in vain",
    )
