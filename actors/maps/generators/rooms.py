"""Rooms and corridors on 16 px blocks, in the style of the public exploration and navigation maps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from actors.maps.generators.base import Generator, Plan, Share
from actors.maps.layout import BLOCK


@dataclass(frozen=True, slots=True)
class _Room:
    """A rectangle of blocks, rows counted from the top of the image."""

    left: int
    top: int
    width: int
    height: int

    @property
    def centre(self) -> tuple[int, int]:
        """(row, column) of the block below and right of the middle."""
        return self.top + self.height // 2, self.left + self.width // 2

    def overlaps(self, other: _Room, allowed: int) -> bool:
        """Whether the rooms share more than ``allowed`` blocks in both directions."""
        across = min(self.left + self.width, other.left + other.width) - max(self.left, other.left)
        down = min(self.top + self.height, other.top + other.height) - max(self.top, other.top)
        return across > allowed and down > allowed


@dataclass(frozen=True, slots=True)
class _Style:
    """What distinguishes the two public sets; the values come from a search that docs/maps.md describes.

    Attributes:
        margin: blocks left solid at each edge; one more at the right and at the bottom.
        sides: sides of rooms, blocks.
        grid: room corners lie on multiples of this many blocks from the margin.
        rooms: fewest and most rooms in an image of 40 x 30 blocks.
        overlap: blocks that two rooms may share in both directions.
        loops: chance per room of one more corridor.
        nub: blocks by which a corridor reaches past its upper numbers, at most, as the public ones do.
        wide: share of corridors three blocks wide, instead of two.
        far: chance that start and target lie in the two rooms furthest apart (navigation).
    """

    margin: int
    sides: tuple[int, ...]
    grid: int
    rooms: tuple[int, int]
    overlap: int
    loops: float
    nub: int
    wide: float
    far: float


_STYLES = {
    "exploration": _Style(2, (4, 6), 2, (6, 8), overlap=4, loops=0.2, nub=1, wide=0.0, far=0.0),
    "navigation": _Style(1, (4, 5), 1, (3, 8), overlap=1, loops=0.1, nub=2, wide=0.1, far=0.7),
}
_ATTEMPTS = 25


class Rooms(Generator):
    """Rooms joined by right-angled corridors, as in the public maps."""

    kind: ClassVar[str] = "rooms"

    width: Annotated[int, Field(ge=12 * BLOCK, le=4096)] = 640
    """Width of the image, pixels; a multiple of 16."""
    height: Annotated[int, Field(ge=12 * BLOCK, le=4096)] = 480
    """Height of the image, pixels; a multiple of 16."""
    style: Literal["exploration", "navigation"] = "exploration"
    """Which public set to follow."""
    min_rooms: Annotated[int, Field(ge=0, le=200)] = 0
    """Fewest rooms, at least two (a full map may hold fewer); 0 for the style's number, scaled with the area."""
    max_rooms: Annotated[int, Field(ge=0, le=200)] = 0
    """Most rooms; 0 for the style's number, scaled with the area."""
    loops: Share | None = None
    """Chance per room of one more corridor, which closes a loop; the style's when not given."""

    @model_validator(mode="after")
    def _numbers_fit(self) -> Rooms:
        if self.max_rooms and self.max_rooms < self.min_rooms:
            raise ValueError(f"max_rooms ({self.max_rooms}) must not be below min_rooms ({self.min_rooms})")
        return self

    def plan(self, rng: np.random.Generator) -> Plan:
        """Place rooms one after the other, join each to the one before, then add loops."""
        style = _STYLES[self.style]
        count = self._count(rng, style)
        rooms: list[_Room] = []
        while len(rooms) < 2:  # in a small image the first room may leave no place for a second one
            rooms = self._place(rng, style, count)
        blocks = np.zeros((self.height // BLOCK, self.width // BLOCK), dtype=np.bool_)
        for room in rooms:
            blocks[room.top : room.top + room.height, room.left : room.left + room.width] = True
        pairs = list(pairwise(rooms))
        chance = style.loops if self.loops is None else self.loops
        for _ in range(int(np.count_nonzero(rng.random(len(rooms)) < chance))):
            first, second = rng.permutation(len(rooms))[:2]
            pairs.append((rooms[int(first)], rooms[int(second)]))
        for first_room, second_room in pairs:
            wide = 3 if rng.random() < style.wide else 2
            nub = int(rng.integers(style.nub + 1))
            _carve(blocks, first_room.centre, second_room.centre, wide, nub, bool(rng.integers(2)))
        free = np.ascontiguousarray(blocks[::-1].repeat(BLOCK, axis=0).repeat(BLOCK, axis=1))
        start, target = self._ends(rng, style, rooms)
        return Plan(free=free, start=start, target=target)

    def _count(self, rng: np.random.Generator, style: _Style) -> int:
        # A quarter of the area holds half of the rooms: with a quarter of them it would be one corridor.
        area = self.width * self.height / (640 * 480)
        scale = max(area, area**0.5)
        most = max(2, self.max_rooms or self.min_rooms or round(style.rooms[1] * scale))
        fewest = max(2, self.min_rooms or min(most, round(style.rooms[0] * scale)))
        return int(rng.integers(fewest, most + 1))

    def _place(self, rng: np.random.Generator, style: _Style, count: int) -> list[_Room]:
        rooms: list[_Room] = []
        across = self.width // BLOCK - 2 * style.margin - 1
        down = self.height // BLOCK - 2 * style.margin - 1
        for _ in range(_ATTEMPTS * count):
            width, height = (style.sides[int(side)] for side in rng.integers(len(style.sides), size=2))
            left = style.margin + style.grid * int(rng.integers((across - width) // style.grid + 1))
            top = style.margin + style.grid * int(rng.integers((down - height) // style.grid + 1))
            room = _Room(left, top, width, height)
            if not any(room.overlaps(other, style.overlap) for other in rooms):
                rooms.append(room)
            if len(rooms) == count:
                break
        return rooms

    def _ends(
        self, rng: np.random.Generator, style: _Style, rooms: list[_Room]
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Choose start and target: random blocks of two rooms, or their middles in the navigation style."""
        start, target = rooms[0], rooms[-1]
        if self.style == "exploration":
            target = max(rooms[1:], key=lambda room: _steps(room.centre, start.centre))
        elif rng.random() < style.far:
            pairs = [(a, b) for number, a in enumerate(rooms) for b in rooms[:number]]
            start, target = max(pairs, key=lambda pair: _steps(pair[0].centre, pair[1].centre))
        if self.style == "navigation":
            return self._middle(start), self._middle(target)
        spot = self._block(rng, start)
        goal = self._block(rng, target)
        while goal == spot:  # the rooms may overlap
            goal = self._block(rng, target)
        return spot, goal

    def _middle(self, room: _Room) -> tuple[int, int]:
        half = BLOCK // 2
        return half * (2 * room.left + room.width), self.height - half * (2 * room.top + room.height)

    def _block(self, rng: np.random.Generator, room: _Room) -> tuple[int, int]:
        column = room.left + int(rng.integers(room.width))
        row = room.top + int(rng.integers(room.height))
        return column * BLOCK + BLOCK // 2, self.height - row * BLOCK - BLOCK // 2


def _steps(a: tuple[int, int], b: tuple[int, int]) -> int:
    return abs(a[0] - b[0]) + abs(a[1] - b[1])


def _carve(
    blocks: NDArray[np.bool_],
    a: tuple[int, int],
    b: tuple[int, int],
    wide: int,
    nub: int,
    across_first: bool,
) -> None:
    """Carve a right-angled corridor between two centres, given as (row, column) of the block after the middle."""
    row, column = (a[0], b[1]) if across_first else (b[0], a[1])
    end = wide - 1 + nub
    blocks[row - 1 : row - 1 + wide, min(a[1], b[1]) - 1 : max(a[1], b[1]) + end] = True
    blocks[min(a[0], b[0]) - 1 : max(a[0], b[0]) + end, column - 1 : column - 1 + wide] = True
