"""What the decision loop hands to the rest of the bridge."""

from __future__ import annotations

from dataclasses import dataclass

from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position
from deploy.bridge.mission import Orders
from deploy.bridge.unseen import Unseen
from deploy.safety.health import Fault


@dataclass(frozen=True, slots=True)
class Course:
    """Where the robot is on its way to; all positions (x, y) in the map frame, metres.

    Attributes:
        waypoint: the planner's choice.
        beacon: the area that it leads to, where the planner has such a notion.
        via: corners of the way to the waypoint.
        path: everything planned beyond the waypoint, for display.
        route: what may be driven, corner by corner: the way to the waypoint and the free beginning of the path.
        with_room: the robot fits at the waypoint by the map; it may be sent to places beside walls as well.
        reason: why this one, where the planner says so.
    """

    waypoint: Position
    beacon: Position | None
    via: tuple[Position, ...]
    path: tuple[Position, ...]
    route: tuple[Position, ...]
    with_room: bool
    reason: str = ""

    @property
    def goal(self) -> Position:
        """The beacon, or the waypoint where there is none."""
        return self.beacon or self.waypoint


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one pass of the decision loop came to.

    Attributes:
        orders: what the robot is told to do.
        hold: why it stands although it was told to move; empty while it goes, and without such orders.
        course: where it goes; None while it stands.
        aim: the corner of the course's way that a robot driven by a stack of its own is sent to; None while it stands.
        planner: name of the planner in charge.
        relieved: why the fallback is in charge; empty while it is not.
        decided: a planner decided in this pass.
        seconds: time of refreshing the map and planning.
        faults: all that is wrong.
        mapper: the map of this pass, valid until the next one; None while there is none.
        pose: of the robot, None while there is none.
        checks: checks in a row that found nothing left to do.
        bans: places that are left alone.
        unseen: what the exploration left at its end; None before, and where it left nothing.
    """

    orders: Orders
    hold: str
    course: Course | None
    aim: Position | None
    planner: str
    relieved: str
    decided: bool
    seconds: float
    faults: tuple[Fault, ...]
    mapper: Mapper | None
    pose: Pose | None
    checks: int
    bans: tuple[Position, ...]
    unseen: Unseen | None
