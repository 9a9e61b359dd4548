"""What all generators share: parameters, seeds, names and the assembly of a map.

A generator draws what an image of the public format would hold: its sizes are pixels, of which 16 are one block and
one nominal lattice step (4 m at 0.25 m per pixel). The scale is given when a world is drawn, as it is for a PNG file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from actors.maps.grid_map import GridMap
from actors.maps.layout import BLOCK, build_map

Side = Annotated[int, Field(ge=8 * BLOCK, le=4096)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A generated place in pixels, before it gets its scale.

    Attributes:
        free: bool, shape (rows, columns), row 0 at the bottom.
        start: (x, y) in pixels from the lower left corner, on a corner of pixels.
        target: likewise.
    """

    free: NDArray[np.bool_]
    start: tuple[int, int]
    target: tuple[int, int]


class Generator(BaseModel, ABC):
    """A family of worlds: the same parameters and seed give the same world on every machine.

    Every world is guaranteed: all free space is 4-connected, the lattice through the block centres is one connected
    graph of viewpoints (20 neighbours in line of sight), each free cell is seen from one of them, and start and target
    are free and apart.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)

    kind: ClassVar[str]
    """Name in specifications."""

    width: Side = 640
    """Width of the image, pixels; a multiple of 16."""
    height: Side = 480
    """Height of the image, pixels; a multiple of 16."""
    seed: Annotated[int, Field(ge=0, lt=2**62)] = 0
    """World i is drawn from seed + i."""
    start_offset: Annotated[int, Field(ge=0, le=BLOCK // 2)] = 0
    """The robot starts up to this many pixels beside a viewpoint of the lattice, along an axis or a diagonal."""

    @model_validator(mode="after")
    def _whole_blocks(self) -> Self:
        if self.width % BLOCK or self.height % BLOCK:
            raise ValueError(f"width and height must be multiples of {BLOCK} px, got {self.width} x {self.height}")
        return self

    @abstractmethod
    def plan(self, rng: np.random.Generator) -> Plan:
        """Draw one place; all chance comes from ``rng``, by ``integers``, ``random`` and ``permutation`` alone."""

    @property
    def label(self) -> str:
        """Kind and the parameters that differ from their defaults, the seed excluded."""
        given = [
            f"{name}={getattr(self, name)}"
            for name, field in type(self).model_fields.items()
            if name != "seed" and getattr(self, name) != field.default
        ]
        return self.kind + (f"[{','.join(given)}]" if given else "")

    def name_of(self, index: int) -> str:
        """Return the name of world number ``index`` without drawing it."""
        return f"{self.label}-{self.seed + index}"

    def world(self, index: int, metres_per_pixel: float = 0.25) -> GridMap:
        """Draw world number ``index``.

        Args:
            index: 0 or more.
            metres_per_pixel: scale, as for PNG maps.

        Returns:
            A map with start and target.
        """
        seed = self.seed + index
        plan = self.plan(np.random.Generator(np.random.PCG64(seed)))
        start = self._start_beside(plan, seed) if self.start_offset else plan.start
        return build_map(self.name_of(index), plan.free, metres_per_pixel, start, plan.target)

    def _start_beside(self, plan: Plan, seed: int) -> tuple[int, int]:
        """Move the start as far as free space lets it, in the direction where it gets farthest; the seed decides ties.

        Chance of its own, so that the same seed gives the same place with and without an offset.
        """
        directions = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])
        np.random.Generator(np.random.PCG64([seed, 1])).shuffle(directions)
        ways = [_free_steps(plan.free, plan.start, (int(i), int(j)), self.start_offset) for i, j in directions]
        steps = max(ways)
        i, j = directions[ways.index(steps)]
        return plan.start[0] + steps * int(i), plan.start[1] + steps * int(j)


def _free_steps(free: NDArray[np.bool_], start: tuple[int, int], direction: tuple[int, int], longest: int) -> int:
    """Count the steps from corner to corner of pixels until one of the four pixels around a corner is not free."""
    for step in range(1, longest + 1):
        x, y = start[0] + step * direction[0], start[1] + step * direction[1]
        if not free[y - 1 : y + 1, x - 1 : x + 1].all():
            return step - 1
    return longest
