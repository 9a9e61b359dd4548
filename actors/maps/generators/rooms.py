"""Rooms and corridors on 16 px blocks, in the style of the public exploration and navigation maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from actors.maps.generators.base import Generator, Plan
from actors.maps.layout import BLOCK

_Room = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class _Style:
    """What distinguishes the two public sets."""

    margin: int
    sides: tuple[int, ...]
    grid: int
    rooms: tuple[int, int]


_STYLES = {
    "exploration": _Style(margin=2, sides=(4, 6), grid=2, rooms=(5, 10)),
    "navigation": _Style(margin=1, sides=(4, 5, 6, 7), grid=1, rooms=(3, 9)),
}


class Rooms(Generator):
    """Rooms joined by right-angled corridors two blocks wide, as in the public maps."""

    kind: ClassVar[str] = "rooms"

    width: Annotated[int, Field(ge=12 * BLOCK, le=4096)] = 640
    """Width of the image, pixels; a multiple of 16."""
    height: Annotated[int, Field(ge=12 * BLOCK, le=4096)] = 480
    """Height of the image, pixels; a multiple of 16."""
    style: Literal["exploration", "navigation"] = "exploration"
    """Which public set the sizes and numbers of rooms follow."""
    min_rooms: Annotated[int, Field(ge=0, le=200)] = 0
    """Fewest rooms, at least two (a full map may hold fewer); 0 for the style's own number, scaled with the area."""
    max_rooms: Annotated[int, Field(ge=0, le=200)] = 0
    """Most rooms; 0 for the style's own number, scaled with the area."""

    @model_validator(mode="after")
    def _whole_blocks(self) -> Rooms:
        if self.width % BLOCK or self.height % BLOCK:
            raise ValueError(f"width and height must be multiples of {BLOCK} px, got {self.width} x {self.height}")
        if self.max_rooms and self.max_rooms < self.min_rooms:
            raise ValueError(f"max_rooms ({self.max_rooms}) must not be below min_rooms ({self.min_rooms})")
        return self

    def plan(self, rng: np.random.Generator) -> Plan:
        """Place rooms one after the other and join each to the one before."""
        style = _STYLES[self.style]
        rows, columns = self.height // BLOCK, self.width // BLOCK
        share = rows * columns / 1200
        most = max(2, self.max_rooms or self.min_rooms or round(style.rooms[1] * share))
        fewest = max(2, self.min_rooms or min(most, round(style.rooms[0] * share)))
        count = int(rng.integers(fewest, max(fewest, most) + 1))
        blocks = np.zeros((rows, columns), dtype=np.bool_)
        rooms: list[_Room] = []
        while len(rooms) < 2:  # in a small image the first rooms may leave no place for a second one
            blocks, rooms = _carve(rng, style, rows, columns, count)
        start, target = rooms[0], rooms[-1]
        if self.style == "exploration":
            start = rooms[int(rng.integers(len(rooms) - 1))]
        free = blocks.repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
        return Plan(free=free, start=_spot(rng, start), target=_spot(rng, target))


def _carve(
    rng: np.random.Generator, style: _Style, rows: int, columns: int, count: int
) -> tuple[NDArray[np.bool_], list[_Room]]:
    """Return the free blocks and the rooms, at most ``count``, that found a place."""
    blocks = np.zeros((rows, columns), dtype=np.bool_)
    rooms: list[_Room] = []
    for _ in range(20 * count):
        if len(rooms) == count:
            break
        room = _place(rng, style, rows, columns)
        if any(_overlap(room, other) for other in rooms):
            continue
        left, bottom, wide, high = room
        blocks[bottom : bottom + high, left : left + wide] = True
        if rooms:
            _join(blocks, rooms[-1], room, bool(rng.integers(2)))
        rooms.append(room)
    return blocks, rooms


def _place(rng: np.random.Generator, style: _Style, rows: int, columns: int) -> _Room:
    """Return (left, bottom, width, height) of a room in blocks, at least one corridor's nub inside the margin."""
    wide = style.sides[int(rng.integers(len(style.sides)))]
    high = style.sides[int(rng.integers(len(style.sides)))]
    across = (columns - 2 * style.margin - wide) // style.grid
    up = (rows - 2 * style.margin - high) // style.grid
    return (
        style.margin + style.grid * int(rng.integers(max(across, 0) + 1)),
        style.margin + style.grid * int(rng.integers(max(up, 0) + 1)),
        wide,
        high,
    )


def _overlap(a: _Room, b: _Room) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def _join(
    blocks: NDArray[np.bool_],
    a: _Room,
    b: _Room,
    across_first: bool,
) -> None:
    """Carve a right-angled corridor, two blocks wide, from the middle of room ``a`` to the middle of room ``b``."""
    ax, ay = a[0] + a[2] // 2, a[1] + a[3] // 2
    bx, by = b[0] + b[2] // 2, b[1] + b[3] // 2
    row, column = (ay, bx) if across_first else (by, ax)
    blocks[row - 1 : row + 1, min(ax, bx) - 1 : max(ax, bx) + 1] = True
    blocks[min(ay, by) - 1 : max(ay, by) + 1, column - 1 : column + 1] = True


def _spot(rng: np.random.Generator, room: _Room) -> tuple[int, int]:
    """Return the centre of a random block of a room, pixels."""
    column = room[0] + int(rng.integers(room[2]))
    row = room[1] + int(rng.integers(room[3]))
    return column * BLOCK + BLOCK // 2, row * BLOCK + BLOCK // 2
