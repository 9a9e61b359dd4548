"""Hand-made floor plans at 0.1 m a cell, with known facts: which of their rooms a robot of 0.25 m radius can get to.

They stand in for the public floor plans, which are no part of the repository.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from actors.maps.grid_map import GridMap

RESOLUTION = 0.1
RADIUS = 0.25
"""Radius of the robot of `Plan.reachable`, metres."""
SPACING = 4.0
"""Spacing of the viewpoint lattice that `diagonal_corridor` is made for, metres."""

Position = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A floor plan and what is known about it.

    Attributes:
        world: the map; its start lies in the first of the rooms.
        rooms: a clear place in each room, (x, y) in metres, by the room's name.
        reachable: names of the rooms to which a disc of `RADIUS` can be moved from the start.
        free_reachable: names of the rooms that are connected with the start by free cells (4-connected).
    """

    world: GridMap
    rooms: dict[str, Position]
    reachable: frozenset[str]
    free_reachable: frozenset[str]


class _Drawing:
    """Cells to be carved and filled by rectangles in metres."""

    def __init__(self, width: float, height: float) -> None:
        self.free: NDArray[np.bool_] = np.zeros((_cells(height), _cells(width)), dtype=np.bool_)

    def carve(self, left: float, bottom: float, right: float, top: float) -> None:
        self.free[_cells(bottom) : _cells(top), _cells(left) : _cells(right)] = True

    def fill(self, left: float, bottom: float, right: float, top: float) -> None:
        self.free[_cells(bottom) : _cells(top), _cells(left) : _cells(right)] = False

    def world(self, name: str, start: Position, target: Position, lattice: Position) -> GridMap:
        return GridMap(
            name=name,
            free=self.free,
            resolution=RESOLUTION,
            origin=(0.0, 0.0),
            start=start,
            target=target,
            target_region=None,
            lattice_origin=lattice,
        )


def office_floor() -> Plan:
    """A corridor of 2 m with rooms behind doors of 0.8, 0.9 and 1.0 m, and one behind a gap of 0.4 m.

    28.4 m x 12.4 m with its outer walls. The far room opens only into the room with the door of 0.8 m, by a door of
    0.9 m; the closet is open to beams and to nothing wider than 0.4 m; the shaft has no door at all.
    """
    drawing = _Drawing(28.4, 12.4)
    drawing.carve(0.2, 5.2, 28.2, 7.2)  # corridor
    drawing.carve(0.2, 7.4, 7.0, 12.2)  # north west, door 0.8 m
    drawing.carve(3.1, 7.2, 3.9, 7.4)
    drawing.carve(7.2, 7.4, 14.0, 12.2)  # far room, door 0.9 m from north west
    drawing.carve(7.0, 9.5, 7.2, 10.4)
    drawing.carve(14.2, 7.4, 21.0, 12.2)  # north, door 0.9 m
    drawing.carve(17.5, 7.2, 18.4, 7.4)
    drawing.carve(21.2, 7.4, 28.2, 12.2)  # north east, door 1.0 m
    drawing.carve(24.0, 7.2, 25.0, 7.4)
    drawing.carve(0.2, 0.2, 9.0, 5.0)  # south west, door 0.9 m
    drawing.carve(1.3, 5.0, 2.2, 5.2)
    drawing.carve(9.2, 0.2, 18.0, 5.0)  # closet, gap 0.4 m
    drawing.carve(13.3, 5.0, 13.7, 5.2)
    drawing.carve(18.2, 0.2, 28.2, 5.0)  # shaft, closed
    rooms = {
        "corridor": (2.0, 6.2),
        "north west": (3.5, 10.0),
        "far": (10.5, 10.0),
        "north": (17.5, 10.0),
        "north east": (24.5, 10.0),
        "south west": (4.5, 2.5),
        "closet": (13.5, 2.5),
        "shaft": (23.0, 2.5),
    }
    return Plan(
        drawing.world("office floor", rooms["corridor"], rooms["far"], (0.8, 0.8)),
        rooms,
        frozenset(rooms) - {"closet", "shaft"},
        frozenset(rooms) - {"shaft"},
    )


def two_rooms() -> Plan:
    """Two rooms of a flat, joined by a door of 0.9 m, with a closet behind a gap of 0.4 m.

    9.4 m x 5.4 m. A partition hides the alcove of the second room from the first.
    """
    drawing = _Drawing(9.4, 5.4)
    drawing.carve(0.2, 0.2, 4.2, 3.6)  # first room
    drawing.carve(4.4, 0.2, 9.2, 5.2)  # second room
    drawing.carve(4.2, 0.8, 4.4, 1.7)  # door 0.9 m
    drawing.fill(6.8, 0.2, 7.0, 4.0)  # partition
    drawing.carve(0.2, 3.8, 4.2, 5.2)  # closet, gap 0.4 m
    drawing.carve(2.0, 3.6, 2.4, 3.8)
    rooms = {"first": (1.0, 2.8), "second": (5.5, 1.5), "alcove": (8.2, 1.0), "closet": (1.0, 4.5)}
    return Plan(
        drawing.world("two rooms", rooms["first"], rooms["alcove"], (0.8, 0.8)),
        rooms,
        frozenset(rooms) - {"closet"},
        frozenset(rooms),
    )


def diagonal_corridor() -> Plan:
    """Two rooms joined by a corridor 2.5 m wide at 45 degrees that lies between the lattice's points.

    36 m x 36 m. No point of the lattice with `SPACING` through the map's `lattice_origin` lies in the corridor: all are
    at least 1.41 m from its middle line, which is 1.25 m from its walls.
    """
    drawing = _Drawing(36.0, 36.0)
    rows, columns = np.indices(drawing.free.shape)
    x, y = (columns + 0.5) * RESOLUTION, (rows + 0.5) * RESOLUTION
    # The middle line is y = x + 2, a lattice through (2, 2) has its points at y - x = 0, 4, 8, ...
    drawing.free |= (np.abs(y - x - 2.0) / np.sqrt(2.0) < 1.25) & (x > 4.0) & (x < 30.0)
    drawing.carve(0.5, 0.5, 8.5, 8.5)
    drawing.carve(27.5, 27.5, 35.5, 35.5)
    rooms = {"low": (3.0, 3.0), "corridor": (18.0, 20.0), "high": (33.0, 33.0)}
    everything = frozenset(rooms)
    world = drawing.world("diagonal corridor", rooms["low"], rooms["high"], (2.0, 2.0))
    return Plan(world, rooms, everything, everything)


def crawlway() -> Plan:
    """A room, and behind it a dead end 0.6 m wide with two bends, where only a line of cells is clear of both walls.

    16.4 m x 8.4 m; double walls of real buildings are like it.
    """
    drawing = _Drawing(16.4, 8.4)
    drawing.carve(0.2, 0.2, 8.2, 8.2)  # room
    drawing.carve(8.2, 7.2, 16.2, 7.8)  # crawlway
    drawing.carve(15.6, 4.2, 16.2, 7.2)
    drawing.carve(11.6, 4.2, 16.2, 4.8)
    rooms = {"room": (4.0, 4.0), "end": (12.0, 4.5)}
    return Plan(
        drawing.world("crawlway", rooms["room"], rooms["end"], (0.0, 0.0)), rooms, frozenset(rooms), frozenset(rooms)
    )


def furnished_hall() -> Plan:
    """A hall of 16 m x 10 m with rows of desks, shelves and a counter.

    Between the desks are aisles of 0.8 m; behind the counter is a place that only a gap of 0.4 m leads to; a ring of
    shelves encloses a place with no way in.
    """
    drawing = _Drawing(16.4, 10.4)
    drawing.carve(0.2, 0.2, 16.2, 10.2)
    for row in range(4):
        for column in range(3):
            left, bottom = 3.0 + 2.4 * column, 1.0 + 1.6 * row  # desks 1.6 m x 0.8 m, aisles of 0.8 m
            drawing.fill(left, bottom, left + 1.6, bottom + 0.8)
    drawing.fill(12.0, 0.2, 12.3, 3.6)  # counter along a corner, with a gap of 0.4 m at its end
    drawing.fill(12.0, 3.6, 15.8, 3.9)
    for left, bottom, right, top in (
        (12.5, 6.0, 15.5, 6.3),
        (12.5, 8.7, 15.5, 9.0),
        (12.5, 6.0, 12.8, 9.0),
        (15.2, 6.0, 15.5, 9.0),
    ):
        drawing.fill(left, bottom, right, top)  # ring of shelves
    rooms = {
        "door": (1.5, 9.0),
        "between the desks": (5.0, 3.8),
        "behind the shelves": (15.85, 7.5),
        "behind the counter": (14.0, 2.0),
        "inside the shelves": (14.0, 7.5),
    }
    return Plan(
        drawing.world("furnished hall", rooms["door"], rooms["between the desks"], (0.8, 0.8)),
        rooms,
        frozenset({"door", "between the desks", "behind the shelves"}),
        frozenset(rooms) - {"inside the shelves"},
    )


def all_plans() -> list[Plan]:
    """Return one of each."""
    return [office_floor(), two_rooms(), diagonal_corridor(), furnished_hall()]


def write_image(plan: Plan, path: Path) -> str:
    """Write a plan as a gray image with its free cells white, and return the map source of it."""
    Image.fromarray(np.where(plan.world.free[::-1], np.uint8(254), np.uint8(0))).save(path)
    x, y = plan.world.start
    return f"floorplans:{path}?start={x},{y}"


def clear_cells(free: NDArray[np.bool_], radius: float, resolution: float = RESOLUTION) -> NDArray[np.bool_]:
    """Return the cells whose centre is at least a radius from the nearest point of any cell that is not free."""
    reach = int(np.ceil(radius / resolution)) + 1
    padded = np.pad(free, reach)
    clear = free.copy()
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            gap = np.hypot(max(abs(i) - 0.5, 0.0), max(abs(j) - 0.5, 0.0)) * resolution
            if gap < radius - 1e-9:
                rows, columns = free.shape
                clear &= padded[reach + i : reach + i + rows, reach + j : reach + j + columns]
    return clear


def _cells(metres: float) -> int:
    return round(metres / RESOLUTION)
