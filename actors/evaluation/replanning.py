"""When the robot of an evaluation decides again: for the command line, which imports no settings, and for these."""

from __future__ import annotations

from enum import StrEnum


class Replan(StrEnum):
    """When the robot decides again."""

    WAYPOINTS = "waypoints"
    """At its waypoints alone."""
    SEEN = "seen"
    """Also on its way, once nothing is left to see from its goal, as the bridge does."""
