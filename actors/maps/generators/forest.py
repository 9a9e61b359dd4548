"""Round trunks in the open: no walls to follow, many small obstacles, sight through gaps."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from actors.maps.generators.base import Generator, Plan, Share, Side
from actors.maps.generators.lattice import finish
from actors.maps.generators.shapes import fill_disc, smooth_noise
from actors.maps.layout import BLOCK

_CELL = 12


class Forest(Generator):
    """Trunks of different girth, denser in some places, inside an irregular edge of undergrowth."""

    kind: ClassVar[str] = "forest"

    width: Side = 384
    """Width of the image, pixels; a multiple of 16."""
    height: Side = 288
    """Height of the image, pixels; a multiple of 16."""
    density: Share = 0.35
    """Share of the places 3 m apart that hold a trunk, on average."""
    min_radius: Annotated[int, Field(ge=1, le=8)] = 1
    """Radius of the thinnest trunk, pixels."""
    max_radius: Annotated[int, Field(ge=1, le=8)] = 4
    """Radius of the thickest trunk, pixels."""

    @model_validator(mode="after")
    def _radii_in_order(self) -> Forest:
        if self.max_radius < self.min_radius:
            raise ValueError(f"max_radius ({self.max_radius}) must not be below min_radius ({self.min_radius})")
        return self

    def plan(self, rng: np.random.Generator) -> Plan:
        """Draw the edge, then one trunk at most per square of 12 px, where a slow noise allows it."""
        shape = (self.height, self.width)
        rows, columns = np.arange(self.height), np.arange(self.width)
        to_edge = np.minimum(np.minimum(rows, rows[::-1])[:, None], np.minimum(columns, columns[::-1])[None, :])
        free = to_edge * 1000 >= BLOCK * 500 + smooth_noise(rng, shape, 2 * BLOCK) * BLOCK * 2
        thickness = smooth_noise(rng, shape, 5 * BLOCK)
        places = np.stack(np.meshgrid(rows[: -_CELL + 1 : _CELL], columns[: -_CELL + 1 : _CELL], indexing="ij"), -1)
        places = places.reshape(-1, 2)
        # All numbers are drawn whether a trunk stands here or not: the density moves no other trunk.
        chance = rng.integers(1000, size=len(places))
        jitter = rng.integers(2 * _CELL, size=places.shape)
        girth = rng.integers(1000, size=len(places))
        radii = 2 * self.min_radius + girth * 2 * (self.max_radius - self.min_radius) // 1000
        stands = chance < 2.0 * self.density * thickness[places[:, 0], places[:, 1]]
        for (y, x), radius in zip((2 * places + jitter)[stands].tolist(), radii[stands].tolist(), strict=True):
            fill_disc(free, x, y, radius * radius, False)
        return finish(free, rng)
