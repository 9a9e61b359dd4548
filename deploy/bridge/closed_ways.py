"""Ways that were free and that something closes by now: a person in a corridor, a door behind which more is to be seen.

What appears may go away again. So before a task ends for want of a way, the robot goes to where such a way is closed,
and waits there for a while. Where many are closed, or a map that has slipped looks as if they were, it does not wait
for each as long: all waits in a row together take less than twice the time of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil, hypot, inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.belief import Belief
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED
from common.planners.base import Plan, Position, Status
from deploy.bridge.cell_way import cells_between, centre_of, nearest_way, pieces
from deploy.bridge.unseen import Unseen, unseen_from

# From so far, metres, the robot sees what closes a way, and whether it still does.
_BEFORE: Final = 1.0
# Frontiers so far, metres, beyond where something stands lie behind it: a door that was hardly looked through.
_THROUGH: Final = 1.0
# Ways to places that are nearer to each other, metres, are waited for once.
_SAME: Final = 1.5
# Of many pieces of space that were cut off no more are looked at in one decision, the largest: people and chairs leave
# many small ones.
_MOST: Final = 16
# A way has opened where the robot can get to so much more floor, square metres, than it ever could.
_OPENED: Final = 1.0
# Between two times that it is asked what to do it stood for no longer, seconds: it may have gone on meanwhile.
_LONGEST: Final = 5.0


@dataclass(slots=True)
class _Wait:
    """For how long the robot waits for the way to a place.

    Attributes:
        beyond: the place, metres.
        until: when it gives up, seconds; infinite while it was not there to look.
        stood: where it stood when that was set, metres.
    """

    beyond: Position
    until: float = inf
    stood: Position = (0.0, 0.0)


class ClosedWays:
    """Remembers where the robot could get to, and waits for ways there when nothing else is left.

    Usage::

        ways.look(mapper)  # now and then
        plan = ways.wait(mapper, place, target, allows, now)  # when the planner says that nothing is left
    """

    def __init__(self, patience: float, radius: float) -> None:
        """Know of none; wait so many seconds before the first closed way, for a robot of this radius, metres."""
        self._patience = patience
        self._radius = radius
        self._belief: Belief | None = None
        self._first = (0, 0)
        self._reached: NDArray[np.bool_] = np.zeros((2, 2), dtype=np.bool_)
        self.begin()

    def begin(self) -> None:
        """Forget all waits. Where the robot could get to stays known as long as the map: it may be told to go there."""
        self._waits: list[_Wait] = []
        # For how long it has stood since a way opened, when it last did, and how many cells it could get to then.
        self._stood = 0.0
        self._last: float | None = None
        self._cells = 0

    def go_on(self, now: float) -> None:
        """Count the time since the robot last waited as none, because it was told to pause."""
        if self._last is not None:
            for wait in self._waits:
                if wait.until > self._last:
                    wait.until += now - self._last
            self._last = now

    def look(self, mapper: Mapper) -> None:
        """Note where the robot can get to; the mapper is not stuck."""
        belief = mapper.belief
        shape, first = belief.padded.shape, belief.first_cell
        if belief is not self._belief:
            self.begin()
            self._belief, self._first, self._reached = belief, first, np.zeros(shape, dtype=np.bool_)
        if shape != self._reached.shape or first != self._first:
            # Beliefs grow, and their cells keep their numbers from the anchor.
            before, (rows, columns) = self._reached, self._reached.shape
            down, right = self._first[0] - first[0], self._first[1] - first[1]
            self._reached = np.zeros(shape, dtype=np.bool_)
            self._reached[down : down + rows, right : right + columns] = before
            self._first = first
        self._reached |= mapper.reachable_cells()

    def wait(
        self, mapper: Mapper, place: Pose, target: Position | None, allows: Callable[[Plan], bool], now: float
    ) -> Plan | None:
        """Go to where a way is closed, and wait there for it to open.

        Args:
            mapper: updated at the place.
            place: of the robot.
            target: of navigation, or None: of an exploration.
            allows: whether a plan leads nowhere that is banned or fenced off; else the robot waits where it is.
            now: seconds.

        Returns:
            None where there is no such way, or all were waited for.
        """
        self.look(mapper)
        self._count(mapper, now)
        for beyond in self._cut_off(mapper):
            if not (_holds(mapper, beyond, target) or unseen_from(mapper, self._radius, beyond, _THROUGH)):
                continue
            wait = self._wait_for(mapper, beyond)
            if now >= wait.until:
                continue
            corners = self._to_closing(mapper, place, beyond)
            if corners and place.distance_to(corners[-1]) > _BEFORE:
                plan = Plan(
                    Status.GOING, waypoint=corners[-1], via=corners[:-1], reason="to a way that something closes"
                )
                if allows(plan):
                    # The time to wait begins there, also where something else stood in the way before.
                    if hypot(corners[-1][0] - wait.stood[0], corners[-1][1] - wait.stood[1]) > _BEFORE + _SAME:
                        wait.until = inf
                    return plan
            if wait.until == inf:
                # Half of what is left of twice the patience.
                wait.until, wait.stood = now + max(self._patience - self._stood / 2.0, 0.0), place.position
            self._last = now
            x, y = wait.beyond
            return Plan(
                Status.STUCK,
                reason=f"something closes the way to ({x:.1f}, {y:.1f}) m, which was free before: waits another "
                f"{wait.until - now:.0f} s for it to open",
            )
        return None

    def _count(self, mapper: Mapper, now: float) -> None:
        """Count the time that the robot has stood before closed ways, and begin anew where one has opened."""
        if self._last is not None:
            self._stood += min(now - self._last, _LONGEST)
            self._last = None
        cells = int(np.count_nonzero(self._reached))
        if cells - self._cells > _OPENED / mapper.belief.resolution**2:
            self._cells = cells
            self._stood = 0.0

    def unseen(self, mapper: Mapper) -> Unseen | None:
        """Return the frontiers of the first space with some that something cuts off; None without any."""
        found = (unseen_from(mapper, self._radius, beyond, _THROUGH) for beyond in self._cut_off(mapper))
        return next((unseen for unseen in found if unseen is not None), None)

    def _cut_off(self, mapper: Mapper) -> Iterator[NDArray[np.bool_]]:
        """Yield the pieces of space where the robot could get to, and cannot any more for what stands there or before.

        What lies beyond and has room belongs to a piece, wherever the robot could get to.
        """
        if mapper.belief is not self._belief:
            return
        reachable, room = mapper.reachable_cells(), mapper.room
        lost = self._reached & ~reachable
        # Beside walls cells come and go with the noise of the map; those have neither room nor an obstacle on them.
        left = lost & (room | (mapper.belief.padded == OCCUPIED))
        passable = lost | (room & ~reachable)
        yield from pieces(passable, left, _MOST)

    def _wait_for(self, mapper: Mapper, beyond: NDArray[np.bool_]) -> _Wait:
        """Return the wait for a piece of space, a new one where there is none near it yet: people move a little."""
        span = ceil(_SAME / mapper.belief.resolution)
        for wait in self._waits:
            row, column = mapper.belief.cell(wait.beyond)
            if beyond[max(row - span, 0) : max(row + span, 0), max(column - span, 0) : max(column + span, 0)].any():
                return wait
        cells = np.flatnonzero(beyond & self._reached)
        self._waits.append(_Wait(centre_of(mapper, int(cells[len(cells) // 2]))))
        return self._waits[-1]

    def _to_closing(self, mapper: Mapper, place: Pose, beyond: NDArray[np.bool_]) -> list[Position]:
        """Return the corners of the way to the last place before what closes the way there; none where that is here."""
        reachable = mapper.reachable_cells()
        trail = cells_between(mapper, place.position, self._reached | reachable, beyond)
        before = [cell for cell in trail if reachable.reshape(-1)[cell]]
        if not before:
            return []
        goal = np.zeros_like(reachable)
        goal.reshape(-1)[before[-1]] = True
        return nearest_way(mapper, place.position, reachable, goal)


def _holds(mapper: Mapper, cells: NDArray[np.bool_], position: Position | None) -> bool:
    """Whether a position lies in cells of the padded grid."""
    if position is None:
        return False
    row, column = mapper.belief.cell(position)
    rows, columns = mapper.belief.shape
    return 0 <= row < rows and 0 <= column < columns and bool(cells[row + 1, column + 1])
