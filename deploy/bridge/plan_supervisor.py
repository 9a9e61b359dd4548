"""Watching over a planner's choices: places that are banned or fenced off, loops, and standstill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import hypot, inf
from typing import Final

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Plan, Position, Status
from deploy.bridge.closed_ways import ClosedWays
from deploy.bridge.detour import detour, useful_nodes
from deploy.bridge.outcome import Course
from deploy.bridge.unseen import Unseen, go_to_unseen
from deploy.config import SafetyConfig
from deploy.safety.blacklist import Ban, Blacklist
from deploy.safety.geofence import Geofence
from deploy.safety.loops import LoopDetector
from deploy.safety.progress import ProgressMonitor

# Places nearer to each other than this count as one where they are banned, metres: robots come to a place so exactly.
_SAME_PLACE: Final = 0.5
# A frontier that is left when the robot has come so near, metres, shows no more.
_LOOKED_AT: Final = 1.0
# Where the robot can get to is noted so often, seconds.
_LOOK_EVERY: Final = 0.5
# The edge of a frontier near a viewpoint, in spacings.
_NEAR: Final = 0.75


class PlanSupervisor:
    """Knows where the robot may go, and notices when it gets nowhere.

    Attributes:
        target: of navigation, which is never banned; None in exploration.
    """

    def __init__(self, safety: SafetyConfig, mapping: MappingConfig) -> None:
        """Ban nothing yet; the graph's room for the robot is kept from the edge of `safety.geofence` too."""
        self.target: Position | None = None
        self._fence = Geofence(safety.geofence, mapping.robot_radius)
        self._blacklist = Blacklist(safety, min(_SAME_PLACE, mapping.viewpoint_spacing / 2.0))
        self._progress = ProgressMonitor(safety)
        self._progress_time = safety.progress_time
        self._loops = LoopDetector()
        self._spacing = mapping.viewpoint_spacing
        self._radius = mapping.robot_radius
        self._ways = ClosedWays(safety.blacklist_time, mapping.robot_radius)
        self._next_look = -inf
        self._waited = False
        # Viewpoints where the robot was with something left to see; the edge of a frontier that it is on its way to,
        # and those where it was.
        self._visited: list[Position] = []
        self._edge: Position | None = None
        self._looked_from: list[Position] = []

    def begin(self, target: Position | None, now: float) -> None:
        """Begin an episode: forget everything."""
        self.target = target
        self._blacklist.clear()
        self._ways.begin()
        self._next_look = now
        self._waited = False
        self._visited.clear()
        self._edge = None
        self._looked_from.clear()
        self._loops.reset()
        self._progress.reset(now)

    def wait(self, now: float) -> None:
        """Count no time of standing by command as time without progress, or of waiting for a way to open."""
        self._progress.reset(now)
        self._ways.go_on(now)

    def bans(self, now: float) -> tuple[Position, ...]:
        """Return the places that are left alone now."""
        return tuple(ban.position for ban in self._blacklist.active(now))

    def may_enter(self, start: Position, end: Position, now: float) -> bool:
        """Whether the robot may drive straight from one position to another: not banned, and inside the fence."""
        return self._blacklist.banned(end, now) is None and self._fence.allows(start, end)

    def allows(self, plan: Plan, place: Pose, now: float) -> bool:
        """Whether a plan leads nowhere that is banned or fenced off."""
        beacon, waypoint = plan.beacon, plan.waypoint
        if beacon is not None and not self._fence.contains(beacon):
            return False
        if beacon is not None and beacon != self.target and self._blacklist.banned(beacon, now) is not None:
            return False
        if waypoint is None:
            return True
        # Corners are no places to be banned: only where the robot is sent is.
        way = [place.position, *plan.via, waypoint]
        return self._blacklist.banned(waypoint, now) is None and all(map(self._fence.allows, way[:-1], way[1:]))

    def around(self, mapper: Mapper, place: Pose, now: float) -> Plan:
        """Look for a way around what is banned and fenced off; wait for bans that are still young."""
        plan = detour(mapper, place, self.target, self._spacing, lambda start, end: self.may_enter(start, end, now))
        if plan.status is not Status.UNREACHABLE:
            return plan
        waits = self._wait_for_bans(now)
        if waits is not None:
            return waits
        why = "could not be reached"
        if self._only_outside(mapper):
            why = "is outside the geofence, or an earlier visit revealed nothing"
        return Plan(Status.UNREACHABLE, reason=f"everything that is left {why}")

    def second_look(self, mapper: Mapper, place: Pose, plan: Plan, now: float) -> Plan:
        """Look for what a planner overlooks that says that nothing is left; else return its plan as it is.

        In an exploration that is a viewpoint with something to see where the robot was not, then the edge of a frontier
        that no viewpoint resolves; for a target, a way that only bans close. In both it is a way, too, that was free
        and that something closes by now.
        """
        if mapper.stuck:
            return plan
        if self.target is not None:
            if plan.status is Status.COMPLETE:
                return plan
            return self._wait_for_bans(now) or self._wait_for_ways(mapper, place, now) or plan
        if len(useful_nodes(mapper, None)):
            found = self.around(mapper, place, now)
            if found.status is not Status.UNREACHABLE:
                return found
            if self._only_outside(mapper):
                plan = replace(plan, reason=found.reason)
        edge = self._to_edge(mapper, place, now, inf)
        return edge or self._wait_for_ways(mapper, place, now) or plan

    def look(self, mapper: Mapper, now: float) -> None:
        """Note where the robot can get to; call it at every pass."""
        if now >= self._next_look and not mapper.stuck:
            self._next_look = now + _LOOK_EVERY
            self._ways.look(mapper)

    def behind_closed_way(self, mapper: Mapper) -> Unseen | None:
        """Return the frontiers behind a way that was free and that something closes; None without any."""
        return None if mapper.stuck else self._ways.unseen(mapper)

    def _only_outside(self, mapper: Mapper) -> bool:
        """Whether nothing that is left to look at lies inside the geofence."""
        left = [mapper.position(int(node)) for node in useful_nodes(mapper, self.target)]
        return not any(map(self._fence.contains, left))

    def look_around(self, mapper: Mapper, place: Pose, now: float) -> Plan | None:
        """On a second visit to a viewpoint, go to the edge of a frontier near by that it sees and does not resolve.

        The graph has one place for a piece of space, and offers another one only when nothing else is left. Without
        this a planner that is drawn to such a frontier comes again and again.

        Args:
            mapper: updated at the place.
            place: of the robot, on its waypoint.
            now: seconds.

        Returns:
            None where there is no such frontier.
        """
        if self.target is not None or mapper.stuck:
            return None
        viewpoint = mapper.position(mapper.robot)
        if place.distance_to(viewpoint) > _LOOKED_AT or mapper.observe().utility[mapper.robot] == 0:
            return None
        if all(gap(viewpoint, other) > _LOOKED_AT for other in self._visited):
            self._visited.append(viewpoint)
            return None
        return self._to_edge(mapper, place, now, _NEAR * self._spacing)

    def _to_edge(self, mapper: Mapper, place: Pose, now: float, farthest: float) -> Plan | None:
        """Go to the edge of the nearest unseen frontier, at most so many metres away; None where there is none."""
        if self._edge is not None and place.distance_to(self._edge) <= _LOOKED_AT:
            self._looked_from.append(self._edge)
        self._edge = None
        bans = self._blacklist.active(now)
        plan = go_to_unseen(mapper, place, self._radius, lambda where: self._skips(where, bans))
        if plan is None or plan.waypoint is None or not self.allows(plan, place, now):
            return None
        if _length([place.position, *plan.via, plan.waypoint]) > farthest:
            return None
        self._edge = plan.waypoint
        return plan

    def _skips(self, frontier: Position, bans: Sequence[Ban]) -> bool:
        """Whether a frontier is not worth going to."""
        return (
            not self._fence.contains(frontier)
            or any(gap(frontier, place) <= _LOOKED_AT + self._radius for place in self._looked_from)
            or any(gap(frontier, ban.position) <= self._blacklist.radius + self._radius for ban in bans)
        )

    def _wait_for_bans(self, now: float) -> Plan | None:
        """Wait for the next banned place that is worth another try; None without any."""
        again = self._blacklist.try_again(now)
        if again is None:
            return None
        ban, seconds = again
        self._note_wait(now)
        when = f"in {seconds:.0f} s" if seconds else "now"
        return Plan(Status.STUCK, reason=f"every way is blocked ({ban.reason}); tries again {when}")

    def _wait_for_ways(self, mapper: Mapper, place: Pose, now: float) -> Plan | None:
        """Wait for ways that something closes, and go to look at them; None without any."""
        plan = self._ways.wait(mapper, place, self.target, lambda plan: self.allows(plan, place, now), now)
        if plan is not None and plan.status is Status.STUCK:
            self._note_wait(now)
        return plan

    def _note_wait(self, now: float) -> None:
        """Note that the robot waits, which is no time without progress."""
        self._waited = True
        self._progress.reset(now)

    def begin_anew(self, plan: Plan, now: float) -> bool:
        """Whether a planner that gave up its target shall forget what it failed at: once after every wait.

        Navigation planners leave out for good what they were asked about in vain, and so all that was blocked before
        the wait, and banned in it.
        """
        if self.target is None or plan.status not in {Status.UNREACHABLE, Status.STUCK} or not self._waited:
            return False
        if self._blacklist.hopeful(now):
            return False
        self._waited = False
        return True

    def watch(self, mapper: Mapper, pose: Pose, course: Course, reached: Position | None, now: float) -> str:
        """Take in where the robot is going, and say why it gets nowhere; empty while it does get somewhere.

        Args:
            mapper: of this moment.
            pose: of the robot.
            course: where it goes.
            reached: waypoint that it has just come to, None on its way.
            now: seconds.
        """
        area = mapper.explored_area
        # Places that the robot came to, not those that it was sent to: a choice may change on the way and harm nobody.
        loop = self._loops.decide(reached, area) if reached is not None else None
        if course.path and course.path[-1] == course.goal and not course.via:
            way: float | None = _length([pose.position, course.waypoint, *course.path])
        else:
            way = None if mapper.stuck else way_to(mapper, pose, course.goal)
        stalled = self._progress.update(now, area, course.goal, way)
        if loop is not None:
            return f"the robot circles through {len(loop.waypoints)} waypoints without new area"
        return f"no new area and no nearer goal for {self._progress_time:g} s" if stalled else ""

    def give_up(self, course: Course, why: str, now: float) -> None:
        """Leave alone, for a while, where the robot was going in vain."""
        places = {course.waypoint, course.goal} - {self.target}
        if len(places) == 2 and gap(course.waypoint, course.goal) <= self._blacklist.radius:
            # The same place is not to be counted as two failures.
            places = {course.waypoint}
        for place in places:
            self._blacklist.add(place, why, now)
        self._progress.reset(now)
        self._loops.reset()


def way_to(mapper: Mapper, pose: Pose, goal: Position) -> float:
    """Return the metres of way from a pose to the viewpoint nearest to a goal, and on to the goal."""
    positions = mapper.viewpoints
    node = int(np.hypot(positions[:, 0] - goal[0], positions[:, 1] - goal[1]).argmin())
    start = mapper.position(mapper.robot)
    return pose.distance_to(start) + float(mapper.distances(mapper.robot)[node]) + gap(mapper.position(node), goal)


def _length(places: list[Position]) -> float:
    return sum(gap(a, b) for a, b in pairwise(places))


def gap(a: Position, b: Position) -> float:
    """Return the straight distance between two positions, metres."""
    return hypot(a[0] - b[0], a[1] - b[1])
