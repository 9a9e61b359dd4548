"""The live view of a deployment in a terminal: the belief as coloured half blocks, the robot, and what it says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.table import Table
from rich.text import Text

from common import palette
from common.geometry import Pose
from common.planners.base import Position
from deploy.robot.simulation import Grid

_UNKNOWN, _FREE, _OCCUPIED = -1, 0, 100
# Most terminals are dark.
_COLOURS = {_UNKNOWN: palette.UNKNOWN.dark, _FREE: palette.FREE.dark, _OCCUPIED: palette.OCCUPIED.dark}
_ROBOT, _WAYPOINT, _WAY = palette.ROBOT.dark, palette.WAYPOINT.dark, palette.WAY.dark


def live_view(
    belief: Grid | None, pose: Pose, way: list[Position], waypoint: Position | None, lines: dict[str, Any], columns: int
) -> Group:
    """Return the view of one moment.

    Args:
        belief: what the bridge knows.
        pose: of the robot, map frame.
        way: positions passed, metres.
        waypoint: where it goes, metres.
        lines: what to write below.
        columns: of characters to fill.
    """
    table = Table.grid(padding=(0, 2))
    for name, value in lines.items():
        table.add_row(Text(name, style="dim"), Text(str(value)))
    if belief is None:
        return Group(Text("waiting for the first map"), table)
    return Group(picture(belief, pose, way, waypoint, columns), table)


def picture(belief: Grid, pose: Pose, way: list[Position], waypoint: Position | None, columns: int) -> Text:
    """Draw the known part of a belief, two rows of cells per line of text, at most ``columns`` characters wide."""
    cells, origin = _known(belief)
    block = max(1, math.ceil(cells.shape[1] / columns))
    small = _reduce(cells, block)
    colours = np.vectorize(_COLOURS.__getitem__, otypes=[object])(small)

    def paint(position: Position, colour: str) -> None:
        column = int((position[0] - origin[0]) / belief.resolution) // block
        row = int((position[1] - origin[1]) / belief.resolution) // block
        if 0 <= row < small.shape[0] and 0 <= column < small.shape[1]:
            colours[row, column] = colour

    for position in way:
        paint(position, _WAY)
    if waypoint is not None:
        paint(waypoint, _WAYPOINT)
    paint(pose.position, _ROBOT)
    text = Text()
    if len(colours) % 2:
        colours = np.vstack([colours, np.full((1, colours.shape[1]), _COLOURS[_UNKNOWN], dtype=object)])
    for low in range(len(colours) - 2, -1, -2):
        for upper, lower in zip(colours[low + 1], colours[low], strict=True):
            text.append("\u2580", style=f"{upper} on {lower}")
        text.append("\n")
    return text


def _known(belief: Grid) -> tuple[NDArray[np.int8], Position]:
    """Return the cells that are known, with a border, and their lower left corner."""
    known = belief.cells != _UNKNOWN
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return belief.cells[:1, :1], belief.origin
    low, left = max(int(rows[0]) - 2, 0), max(int(columns[0]) - 2, 0)
    cells = belief.cells[low : rows[-1] + 3, left : columns[-1] + 3]
    return cells, (belief.origin[0] + left * belief.resolution, belief.origin[1] + low * belief.resolution)


def _reduce(cells: NDArray[np.int8], block: int) -> NDArray[np.int8]:
    """Put blocks of cells into one each: occupied wins, then free."""
    rows, columns = -(-cells.shape[0] // block), -(-cells.shape[1] // block)
    padded = np.full((rows * block, columns * block), _UNKNOWN, dtype=np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    blocks = padded.reshape(rows, block, columns, block)
    occupied = (blocks == _OCCUPIED).any(axis=(1, 3))
    free = (blocks == _FREE).any(axis=(1, 3))
    return np.where(occupied, _OCCUPIED, np.where(free, _FREE, _UNKNOWN)).astype(np.int8)
