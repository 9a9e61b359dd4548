"""Pictures of maps: contact sheets, and distributions of two sets side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from actors.maps.grid_map import GridMap
from actors.maps.layout import marker_region
from common.system.extras import optional

if TYPE_CHECKING:
    from PIL import Image

_WALL = (74, 78, 84)
_FREE = (238, 238, 234)
_START = (255, 190, 0)
_TARGET = (214, 40, 40)
_GAP = 6


def draw(world: GridMap, width: int) -> Image.Image:
    """Draw one map: walls dark, free space light, start yellow, target red.

    Args:
        world: the map.
        width: of the picture, pixels; its height follows.
    """
    with optional("a picture", "actor"):
        from PIL import Image

    image = np.empty((*world.free.shape, 3), dtype=np.uint8)
    image[:] = _WALL
    image[world.free] = _FREE
    shape = (world.free.shape[0], world.free.shape[1])
    for position, colour in ((world.start, _START), (world.target, _TARGET)):
        if position is not None:
            cells = tuple(
                (value - origin) / world.resolution for value, origin in zip(position, world.origin, strict=True)
            )
            image[marker_region(shape, (cells[0], cells[1]))] = colour
    height = max(1, round(width * shape[0] / shape[1]))
    return Image.fromarray(np.ascontiguousarray(image[::-1])).resize((width, height), Image.Resampling.BOX)


def contact_sheet(worlds: Sequence[GridMap], path: Path, columns: int = 5, width: int = 160) -> None:
    """Write maps side by side into one PNG file of few colours.

    Args:
        worlds: the maps, row by row; at least one.
        path: the file; its folder must exist.
        columns: maps per row.
        width: of one map, pixels.
    """
    tiles = [draw(world, width) for world in worlds]
    rows = [tiles[first : first + columns] for first in range(0, len(tiles), columns)]
    heights = [max(tile.height for tile in row) for row in rows]
    across = min(columns, len(tiles))
    size = (across * (width + _GAP) + _GAP, sum(heights) + _GAP * (len(rows) + 1))
    with optional("a picture", "actor"):
        from PIL import Image

    sheet = Image.new("RGB", size, (255, 255, 255))
    top = _GAP
    for row, height in zip(rows, heights, strict=True):
        for number, tile in enumerate(row):
            sheet.paste(tile, (_GAP + number * (width + _GAP), top))
        top += height + _GAP
    sheet.quantize(24).save(path, optimize=True)


def distributions(sets: Mapping[str, Mapping[str, NDArray[np.float64]]], measures: Sequence[str], path: Path) -> None:
    """Write a histogram of each measure, all sets in one frame, with matplotlib (extra ``plots``).

    Args:
        sets: arrays by measure, by name of the set.
        measures: what to show; those without a number in some set are left out.
        path: the PNG file; its folder must exist.
    """
    with optional("a plot", "plots"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    shown = [name for name in measures if all(np.isfinite(one[name]).any() for one in sets.values())]
    across = 4
    down = -(-len(shown) // across)
    figure = Figure(figsize=(3.0 * across, 2.2 * down), layout="constrained")
    FigureCanvasAgg(figure)
    for number, name in enumerate(shown):
        axes = figure.add_subplot(down, across, number + 1)
        values = [one[name][np.isfinite(one[name])] for one in sets.values()]
        whole = all(np.array_equal(one, np.round(one)) for one in values) and np.ptp(np.concatenate(values)) < 20
        low, high = float(min(one.min() for one in values)), float(max(one.max() for one in values))
        bins = np.arange(low - 0.5, high + 1.0) if whole else np.linspace(low, max(high, low + 1e-9), 25)
        for label, one in zip(sets, values, strict=True):
            axes.hist(one, bins=bins.tolist(), density=True, histtype="stepfilled", alpha=0.45, label=label)
        axes.set_title(name.replace("_", " "), fontsize=9)
        axes.set_yticks([])
        axes.tick_params(labelsize=7)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(sets), fontsize=8)
    figure.savefig(path, dpi=80)
