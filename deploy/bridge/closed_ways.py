"""Ways that were free and that something closes by now: a person in a corridor, a door behind which more is to be seen.

What appears may go away again. So before a task ends for want of a way, the robot goes to where such a way is closed,
and waits there for a while.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil, inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.geometry import Pose
from common.mapping.belief import Belief
from common.mapping.mapper import Mapper
from common.mapping.sight import OCCUPIED
from common.planners.base import Plan, Position, Status
from deploy.bridge.cell_way import cells_between, centre_of, flooded, nearest_way
from deploy.bridge.unseen import Unseen, unseen_from

# From so far, metres, the robot sees what closes a way, and whether it still does.
_BEFORE: Final = 1.0
# Frontiers so far, metres, beyond where something stands lie behind it: a door that was hardly looked through.
_THROUGH: Final = 1.0
# Ways to places that are nearer to each other, metres, are waited for once.
_SAME: Final = 1.5
# Of many pieces of space that were cut off no more are looked at in one decision.
_MOST: Final = 16


@dataclass(slots=True)
class _Wait:
    """For how long the robot waits for the way to a place, metres, seconds; infinite while it was not there to look."""

    beyond: Position
    until: float = inf


class ClosedWays:
    """Remembers where the robot could get to, and waits for ways there when nothing else is left.

    Usage::

        ways.look(mapper)  # now and then
        plan = ways.wait(mapper, place, target, allows, now)  # when the planner says that nothing is left
    """

    def __init__(self, patience: float, radius: float) -> None:
        """Know of none; wait so many seconds before each closed way, for a robot of this radius, metres."""
        self._patience = patience
        self._radius = radius
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._belief: Belief | None = None
        self._first = (0, 0)
        self._reached: NDArray[np.bool_] = np.zeros((2, 2), dtype=np.bool_)
        self._waits: list[_Wait] = []

    def look(self, mapper: Mapper) -> None:
        """Note where the robot can get to; the mapper is not stuck."""
        belief = mapper.belief
        shape, first = belief.padded.shape, belief.first_cell
        if belief is not self._belief:
            self.clear()
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
                    wait.until = inf
                    return plan
            wait.until = min(wait.until, now + self._patience)
            x, y = wait.beyond
            return Plan(
                Status.STUCK,
                reason=f"something closes the way to ({x:.1f}, {y:.1f}) m, which was free before: waits another "
                f"{wait.until - now:.0f} s for it to open",
            )
        return None

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
        for _ in range(_MOST):
            first = int(left.argmax())
            if not left.reshape(-1)[first]:
                return
            piece = flooded(passable, first)
            left &= ~piece
            yield piece

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
