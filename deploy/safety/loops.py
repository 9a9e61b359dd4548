"""Notice that decisions repeat themselves."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import inf
from typing import Final

from deploy.config import Point

_AREA_STEP: Final = 0.5
_CELL: Final = 0.25
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Loop:
    """A cycle of waypoints.

    Attributes:
        waypoints: (x, y) of the cycle in the order of visits, metres.
        repeats: how often its last move was made without news.
    """

    waypoints: tuple[Point, ...]
    repeats: int


class LoopDetector:
    """Find cycles of waypoints during which nothing new was seen.

    A deterministic policy on an unchanged map repeats its choices for ever; the sign is the same move, from one
    waypoint to the next, made again and again without new area in between. A long way through known area repeats
    no move.
    """

    def __init__(self, repeats: int = 3) -> None:
        """Call it a loop when a move is made for the `repeats`-th time without news."""
        self._repeats = repeats
        self._area = -inf
        self._trail: list[tuple[Cell, Point]] = []
        self._moves: Counter[tuple[Cell, Cell]] = Counter()

    def decide(self, waypoint: Point, explored_area: float) -> Loop | None:
        """Take in a decision; choosing the same waypoint again is no move.

        Args:
            waypoint: (x, y), metres.
            explored_area: m2.

        Returns:
            The cycle that this decision closes for the n-th time, or None.
        """
        if explored_area >= self._area + _AREA_STEP:
            self._area = explored_area
            self.reset()
        cell = round(waypoint[0] / _CELL), round(waypoint[1] / _CELL)
        if self._trail and self._trail[-1][0] == cell:
            return None
        previous = self._trail[-1][0] if self._trail else None
        self._trail.append((cell, waypoint))
        if previous is None:
            return None
        self._moves[previous, cell] += 1
        count = self._moves[previous, cell]
        if count < self._repeats:
            return None
        return Loop(self._cycle(cell), count)

    def reset(self) -> None:
        """Forget all decisions; call it after a remedy."""
        self._trail.clear()
        self._moves.clear()

    def _cycle(self, cell: Cell) -> tuple[Point, ...]:
        cells = [entry[0] for entry in self._trail]
        start = len(cells) - 2 - cells[-2::-1].index(cell)
        return tuple(point for _, point in self._trail[start:-1])
