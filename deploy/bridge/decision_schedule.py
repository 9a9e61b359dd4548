"""When a planner is asked: not more often than the rate, and not again where nothing has changed."""

from __future__ import annotations

from typing import Final

from common.geometry import Pose

# A robot that moved less and learned nothing keeps its decision: planners take repeated questions from one place for
# repeated failures.
_MOVED: Final = 0.02


class DecisionSchedule:
    """Knows when the next decision may be made, and what the last one was made from.

    All times are seconds of one monotonic clock.
    """

    def __init__(self, rate: float) -> None:
        """Have something decided at once, and then at most so many times per second."""
        self._interval = 1.0 / rate
        self._next = float("-inf")
        self._asked: tuple[Pose, int, int] | None = None

    def restart(self, now: float) -> None:
        """Wait no longer, and count as not asked yet."""
        self._next, self._asked = now, None

    def hurry(self, now: float) -> None:
        """Wait no longer; what was asked last still counts."""
        self._next = now

    def wait(self, now: float) -> None:
        """Wait until the rate allows the next."""
        self._next = now + self._interval

    def note_asked(self, now: float, pose: Pose, version: int, known_cells: int) -> None:
        """Take note that a planner is asked, and wait.

        Args:
            now: seconds.
            pose: of the robot, map frame.
            version: of the map, rising with every sensor message in it.
            known_cells: of the map.
        """
        self.wait(now)
        self._asked = (pose, version, known_cells)

    def may_ask(self, now: float) -> bool:
        """Whether the rate allows a decision."""
        return now >= self._next

    def is_new(self, version: int) -> bool:
        """Whether nothing was asked on this version of the map."""
        return self._asked is None or self._asked[1] != version

    def has_news(self, pose: Pose, known_cells: int) -> bool:
        """Whether the robot has moved or learned something since it was asked, or nothing was asked yet."""
        return self._asked is None or not self.stands(pose) or self._asked[2] != known_cells

    def stands(self, pose: Pose) -> bool:
        """Whether the robot is where it was when it was asked last."""
        return self._asked is not None and pose.distance_to(self._asked[0].position) <= _MOVED
