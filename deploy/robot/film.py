"""A recorded deployment as pictures: what the bridge knows, where the robot is and where it goes."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from actors.evaluation.pixels import to_pixels
from actors.evaluation.plots import belief_picture
from actors.maps.grid_map import GridMap
from common import palette
from common.geometry import Pose
from common.mapping.belief import Belief
from common.planners.base import Position
from deploy.robot.people import RADIUS
from deploy.robot.simulation import Grid

STRIP = 22
HOLD_LAST = 15
PIXELS = 12.0
WIDTHS = 640, 1280
MOST_PICTURES = 900
"""A minute and a half of video; of longer deployments moments are left out evenly."""
MARGIN = 0.5
_ROUTE, _PLAN, _BEACON = palette.WAY.rgb, palette.WAYPOINT.rgb, palette.BEACON.rgb
_PERSON = palette.PERSON.rgb
_ROBOT, _TEXT = palette.ROBOT.rgb, palette.TEXT.rgb


@dataclass(frozen=True, slots=True)
class PackedGrid:
    """A grid that waits to be drawn, in a hundredth of its memory: a deployment has thousands of them.

    Attributes:
        packed: cells, int8, row by row, deflated.
        shape: rows, columns.
        resolution: metres.
        origin: lower left corner of the first cell, metres.
    """

    packed: bytes
    shape: tuple[int, int]
    resolution: float
    origin: Position

    @classmethod
    def of(cls, grid: Grid) -> PackedGrid:
        """Pack a grid."""
        rows, columns = grid.cells.shape
        return cls(zlib.compress(grid.cells.tobytes(), 1), (rows, columns), grid.resolution, grid.origin)

    def grid(self) -> Grid:
        """Return the grid."""
        cells = np.frombuffer(zlib.decompress(self.packed), np.int8).reshape(self.shape)
        return Grid(cells, self.resolution, self.origin)


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One moment of a deployment.

    Attributes:
        time: seconds of the robot.
        pose: true pose.
        belief: what the bridge knows; None before its first map.
        path: waypoint and route beyond it, metres.
        beacon: chosen beacon, metres.
        words: what to write above.
        people: who walk about, metres.
    """

    time: float
    pose: Pose
    belief: PackedGrid | None
    path: tuple[Position, ...]
    beacon: Position | None
    words: str
    people: tuple[Position, ...] = ()


def frames(
    shots: Sequence[Shot], world: GridMap, target: Position | None = None, width: int | None = None
) -> Iterator[Image.Image]:
    """Draw shots over the true walls, the last one long enough to look at it.

    Args:
        shots: oldest first; no more than `MOST_PICTURES` of them are drawn, evenly chosen, the last one included.
        world: true map, for its outline.
        target: navigation target, metres.
        width: pixels; when not given `PIXELS` a metre, within `WIDTHS`, so that doors of a floor can be made out.
    """
    shown = _cropped(world)
    if width is None:
        width = round(min(max(PIXELS * shown.size[0], WIDTHS[0]), WIDTHS[1]))
    camera = _Camera(shown, target, width)
    picture: Image.Image | None = None
    way = [shot.pose.position for shot in shots]
    count = min(len(shots), MOST_PICTURES)
    for last in (len(shots) * (number + 1) // count - 1 for number in range(count)):
        picture = camera.draw(shots[last], way[: last + 1])
        yield picture
    for _ in range(HOLD_LAST if picture is not None else 0):
        assert picture is not None
        yield picture


def _cropped(world: GridMap) -> GridMap:
    """Cut off solid margins but for `MARGIN`, metres."""
    rows, columns = np.flatnonzero(world.free.any(axis=1)), np.flatnonzero(world.free.any(axis=0))
    border = round(MARGIN / world.resolution)
    low, left = max(int(rows[0]) - border, 0), max(int(columns[0]) - border, 0)
    free = world.free[low : rows[-1] + 1 + border, left : columns[-1] + 1 + border]
    origin = world.origin[0] + left * world.resolution, world.origin[1] + low * world.resolution
    return dataclasses.replace(world, free=free, origin=origin, target_region=None)


class _Camera:
    """Draws shots of one world."""

    def __init__(self, world: GridMap, target: Position | None, width: int) -> None:
        rows, columns = world.free.shape
        self._world = world
        self._target = target
        self._scale = width / columns
        # Video codecs want even sides.
        self._size = width // 2 * 2, round(rows * self._scale) // 2 * 2
        self._drawn: PackedGrid | None = None
        self._background: Image.Image | None = None

    def draw(self, shot: Shot, way: list[Position]) -> Image.Image:
        if self._background is None or shot.belief != self._drawn:
            self._drawn = shot.belief
            self._background = self._ground(None if shot.belief is None else shot.belief.grid())
        picture = Image.new("RGB", (self._size[0], self._size[1] + STRIP), (255, 255, 255))
        picture.paste(self._background, (0, STRIP))
        pen = ImageDraw.Draw(picture)
        pen.text((6, 5), shot.words, fill=_TEXT)
        # The legend also puts all colours into the last picture, which gives a GIF its palette.
        end = float(self._size[0])
        for word, colour in (("beacon", _BEACON), ("waypoint", _PLAN), ("way", _ROUTE), ("robot", _ROBOT)):
            end -= 20.0 + pen.textlength(word)
            pen.rectangle((end - 10, 7, end - 3, 14), fill=colour)
            pen.text((end, 5), word, fill=_TEXT)
        points = [self._at(position) for position in way]
        if len(points) > 1:
            pen.line(points, fill=_ROUTE, width=2)
        here = self._at(shot.pose.position)
        if shot.path:
            pen.line([here, *map(self._at, shot.path)], fill=_PLAN, width=1)
            x, y = self._at(shot.path[0])
            pen.ellipse((x - 3, y - 3, x + 3, y + 3), fill=_PLAN)
        if shot.beacon is not None and shot.path:
            x, y = self._at(shot.beacon)
            pen.polygon([(x, y - 6), (x - 5, y + 4), (x + 5, y + 4)], fill=_BEACON)
        radius = RADIUS / self._world.resolution * self._scale
        for person in shot.people:
            x, y = self._at(person)
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=_PERSON, outline=_TEXT)
        if self._target is not None:
            x, y = self._at(self._target)
            pen.ellipse((x - 6, y - 6, x + 6, y + 6), outline=_BEACON, width=3)
        x, y = here
        pen.ellipse((x - 6, y - 6, x + 6, y + 6), fill=_ROBOT, outline=(255, 255, 255))
        nose = (x + 9 * math.cos(shot.pose.yaw), y - 9 * math.sin(shot.pose.yaw))
        pen.line([here, nose], fill=(255, 255, 255), width=2)
        return picture

    def _ground(self, grid: Grid | None) -> Image.Image:
        world = self._world
        resolution = world.resolution if grid is None else grid.resolution
        corner = world.origin if grid is None else grid.origin
        # The picture needs a belief of all the world, in steps of the cells that the bridge has.
        low = [
            at - resolution * math.ceil((at - edge) / resolution) for at, edge in zip(corner, world.origin, strict=True)
        ]
        high = [edge + size for edge, size in zip(world.origin, world.size, strict=True)]
        belief = Belief(resolution, 1.0, bounds=(low[0], low[1], high[0], high[1]))
        if grid is not None:
            belief.assign(grid.cells, grid.origin)
        cells = belief_picture(belief, world)
        how = Image.Resampling.BOX if self._scale < 1.0 else Image.Resampling.NEAREST
        return Image.fromarray(cells).resize(self._size, how)

    def _at(self, position: Position) -> Position:
        column, row = to_pixels(self._world, position)
        return (column + 0.5) * self._scale, (row + 0.5) * self._scale + STRIP
