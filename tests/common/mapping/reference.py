"""The mapping from scratch, slow and obvious: every step is computed from the definition, over all cells and pairs.

Cells are (row, column) numbers from the anchor and live in a dictionary; viewpoints are lattice numbers (i, j). Points
are in 1/65536 cells from the anchor, as the mapping defines them.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, cos, floor, hypot, inf, isnan, pi, sin, sqrt

import numpy as np

from common.config.schema import MappingConfig
from common.geometry import Pose, Scan
from common.observation import NEIGHBOUR_OFFSETS, Observation

UNIT = 65536
FREE, OCCUPIED = 0, 100
TOLERANCE = 1e-3
Cell = tuple[int, int]
Point = tuple[int, int]


@lru_cache(maxsize=200_000)
def touched_cells(a: Point, b: Point) -> list[Cell]:
    """All cells whose closed square meets the closed segment: boxes overlap, and no side of the line holds it all."""
    columns = np.arange((min(a[0], b[0]) - 1) // UNIT, max(a[0], b[0]) // UNIT + 1)
    rows = np.arange((min(a[1], b[1]) - 1) // UNIT, max(a[1], b[1]) // UNIT + 1)
    row, column = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
    sides = np.stack(
        [
            (b[0] - a[0]) * ((row + up) * UNIT - a[1]) - (b[1] - a[1]) * ((column + right) * UNIT - a[0])
            for up in (0, 1)
            for right in (0, 1)
        ]
    )
    meets = ~((sides > 0).all(axis=0) | (sides < 0).all(axis=0))
    return list(zip(row[meets].tolist(), column[meets].tolist(), strict=True))


class ReferenceMapper:
    def __init__(
        self,
        config: MappingConfig,
        lattice_origin: tuple[float, float],
        anchor: tuple[float, float],
        target: tuple[float, float] | None = None,
    ) -> None:
        self.config = config
        self.lattice_origin = lattice_origin
        self.anchor = anchor
        self.target = target
        self.cells: dict[Cell, int] = {}
        self.visited: set[tuple[int, int]] = set()
        self._sight: dict[tuple[Point, Point], bool] = {}

    def point(self, position: tuple[float, float]) -> Point:
        return (
            round((position[0] - self.anchor[0]) / self.config.resolution * UNIT),
            round((position[1] - self.anchor[1]) / self.config.resolution * UNIT),
        )

    def lattice_point(self, viewpoint: tuple[int, int]) -> Point:
        return self.point(self.lattice_position(viewpoint))

    def lattice_position(self, viewpoint: tuple[int, int]) -> tuple[float, float]:
        spacing = self.config.viewpoint_spacing
        return (
            self.lattice_origin[0] + spacing * viewpoint[0],
            self.lattice_origin[1] + spacing * viewpoint[1],
        )

    # ------------------------------------------------------------------------------------------------------- belief

    def integrate(self, scan: Scan, pose: Pose) -> int:
        before = len(self.cells)
        x, y = (value / UNIT for value in self.point(pose.position))
        limit = min(scan.range_max, self.config.sensor_range)
        for beam, value in enumerate(scan.ranges):
            measured = float(value)
            if isnan(measured) or measured < scan.range_min or measured < 0.0:
                continue
            angle = pose.yaw + scan.angle_min + scan.angle_increment * beam
            hit = measured < limit - TOLERANCE
            self._beam(x, y, angle, (measured if hit else limit) / self.config.resolution, hit)
        return len(self.cells) - before

    def _beam(self, x: float, y: float, angle: float, reach: float, hit: bool) -> None:
        tolerance = TOLERANCE / self.config.resolution
        direction_x, direction_y = (0.0 if abs(d) < 1e-12 else d for d in (cos(angle), sin(angle)))
        crossings = []  # (time, step in columns, step in rows)
        for start, direction, step in ((x, direction_x, (1, 0)), (y, direction_y, (0, 1))):
            if direction > 0:
                borders = range(floor(start) + 1, floor(start) + ceil(reach) + 4)
            elif direction < 0:
                borders = range(floor(start), floor(start) - ceil(reach) - 4, -1)
            else:
                continue
            sign = 1 if direction > 0 else -1
            crossings += [((border - start) / direction, sign * step[0], sign * step[1]) for border in borders]
        crossings.sort()
        merged: list[tuple[float, int, int]] = []
        for time, right, up in crossings:
            if merged and time - merged[-1][0] <= 1e-9:
                merged[-1] = (time, merged[-1][1] + right, merged[-1][2] + up)
            else:
                merged.append((time, right, up))
        visits = []  # (cell, entry, exit)
        row, column, entry = floor(y), floor(x), -inf
        for time, right, up in merged:
            visits.append(((row, column), entry, time))
            row, column, entry = row + up, column + right, time
        if not hit:
            freed = [cell for cell, entry, _ in visits if entry < reach - tolerance]
            ends = []
        else:
            freed = [c for c, entry, leave in visits if entry < reach - tolerance and leave <= reach + tolerance]
            borders_near = [crossing for crossing in merged if abs(crossing[0] - reach) <= tolerance]
            ends = [c for c, entry, leave in visits if entry <= reach + tolerance and leave > reach + tolerance]
            if len(borders_near) > 1 or any(right and up for _, right, up in borders_near):
                ends = []
        for cell in freed:
            self.cells.setdefault(cell, FREE)
        for cell in ends:
            self.cells[cell] = OCCUPIED

    def assign(self, values: np.ndarray, row: int, column: int) -> None:
        for r in range(values.shape[0]):
            for c in range(values.shape[1]):
                self.cells.pop((row + r, column + c), None)
                if values[r, c] >= 0:
                    self.cells[row + r, column + c] = int(values[r, c])

    def free(self, cell: Cell) -> bool:
        return self.cells.get(cell) == FREE

    # -------------------------------------------------------------------------------------------------------- graph

    def frontiers(self) -> list[Cell]:
        return sorted(
            (row, column)
            for (row, column), value in self.cells.items()
            if value == FREE
            and sum((row + up, column + right) not in self.cells for up in (-1, 0, 1) for right in (-1, 0, 1)) >= 2
        )

    def clear(self, a: Point, b: Point) -> bool:
        if (a, b) not in self._sight:
            self._sight[a, b] = all(self.free(cell) for cell in touched_cells(a, b))
        return self._sight[a, b]

    def viewpoints(self) -> list[tuple[int, int]]:
        """(i, j) of all lattice points in free cells, row-major."""
        spacing, resolution = self.config.viewpoint_spacing, self.config.resolution
        if not self.cells:
            return []
        rows = [row for row, _ in self.cells]
        columns = [column for _, column in self.cells]
        ranges = []
        for axis, numbers in ((0, columns), (1, rows)):
            shift = self.anchor[axis] - self.lattice_origin[axis]
            low = (min(numbers) * resolution + shift) / spacing
            high = ((max(numbers) + 1) * resolution + shift) / spacing
            ranges.append(range(floor(low) - 1, ceil(high) + 2))
        found = []
        for j in ranges[1]:
            for i in ranges[0]:
                x, y = self.lattice_point((i, j))
                if self.free((y // UNIT, x // UNIT)):
                    found.append((i, j))
        return found

    def distance(self, a: Point, b: Point) -> float:
        return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / UNIT * self.config.resolution

    def within(self, a: Point, b: Point, limit: float) -> bool:
        reach = round(limit / self.config.resolution * UNIT)
        return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 <= reach**2

    # -------------------------------------------------------------------------------------------------- observation

    def update(self, pose: Pose) -> None:
        """Compute everything anew; results are attributes and the observation (None when stuck)."""
        self._sight.clear()
        config = self.config
        viewpoints = self.viewpoints()
        points = {v: self.lattice_point(v) for v in viewpoints}
        self.all_viewpoints = viewpoints
        self.all_edges = {
            v: sum(
                1 << k
                for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS.tolist())
                if (v[0] + dx, v[1] + dy) in points and self.clear(points[v], points[v[0] + dx, v[1] + dy])
            )
            for v in viewpoints
        }
        self.all_frontiers = self.frontiers()
        centres = [(column * UNIT + UNIT // 2, row * UNIT + UNIT // 2) for row, column in self.all_frontiers]
        self.all_counts = {
            v: sum(self.within(points[v], f, config.observable_range) and self.clear(points[v], f) for f in centres)
            for v in viewpoints
        }
        self.observation: Observation | None = None
        robot = self._robot_node(pose, points)
        self.robot = robot
        if robot is None:
            return
        if self.distance(points[robot], self.point(pose.position)) <= config.viewpoint_spacing / 2 + 1e-9:
            self.visited.add(robot)
        nodes = self._reachable(robot)
        self.nodes = nodes
        enough = max((self.all_counts[v] for v in nodes), default=0) >= config.min_utility
        threshold = config.min_utility if enough else min(config.least_utility, config.min_utility)
        utility = [self.all_counts[v] if self.all_counts[v] >= threshold else 0 for v in nodes]
        beacon = self._beacons(nodes, utility, points)
        has_target = self.target is not None
        links: list[int] = []
        known = False
        target_offset = (0.0, 0.0)
        if self.target is not None:
            goal = self.point(self.target)
            at = self.lattice_position(robot)
            target_offset = tuple((self.target[k] - at[k]) / config.viewpoint_spacing for k in (0, 1))
            reach = sqrt(5) * config.viewpoint_spacing + 1e-4 * config.resolution
            far = {n: self.distance(points[v], goal) for n, v in enumerate(nodes)}
            near = [n for n, v in enumerate(nodes) if far[n] <= reach and self.clear(goal, points[v])]
            known = bool(near) and self.free((goal[1] // UNIT, goal[0] // UNIT))
            choice = near if known else [n for n in range(len(nodes)) if beacon[n]]
            links = sorted(sorted(choice, key=lambda n: (far[n], n))[:20])
        self.observation = Observation(
            offsets=np.array([(i - robot[0], j - robot[1]) for i, j in nodes], dtype=np.int16),
            utility=np.array(utility, dtype=np.uint16),
            visited=np.array([v in self.visited for v in nodes]),
            beacon=np.array(beacon),
            edges=np.array([self.all_edges[v] for v in nodes], dtype=np.uint32),
            robot=nodes.index(robot),
            has_target=has_target,
            target_known=known,
            target_offset=np.array(target_offset, dtype=np.float32),
            target_links=np.array(links, dtype=np.uint16),
        )

    def _robot_node(self, pose: Pose, points: dict[tuple[int, int], Point]) -> tuple[int, int] | None:
        here = self.point(pose.position)
        cell = (here[0] // UNIT, here[1] // UNIT)
        choices = [
            (self.all_edges[v] == 0, (p[0] - here[0]) ** 2 + (p[1] - here[1]) ** 2, v[1], v[0])
            for v, p in points.items()
            if self.within(p, here, 3 * self.config.viewpoint_spacing)
            and ((p[0] // UNIT, p[1] // UNIT) == cell or self.clear(here, p))
        ]
        if not choices:
            return None
        _, _, j, i = min(choices)
        return i, j

    def _reachable(self, robot: tuple[int, int]) -> list[tuple[int, int]]:
        found = {robot}
        queue = [robot]
        for v in queue:
            for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS.tolist()):
                there = (v[0] + dx, v[1] + dy)
                if self.all_edges[v] >> k & 1 and there not in found:
                    found.add(there)
                    queue.append(there)
        return sorted(found, key=lambda v: (v[1], v[0]))

    def _beacons(
        self, nodes: list[tuple[int, int]], utility: list[int], points: dict[tuple[int, int], Point]
    ) -> list[bool]:
        """Algorithm 1."""
        covered: set[tuple[int, int]] = set()
        beacons = set()
        for v, useful in zip(nodes, utility, strict=True):
            if not useful or v in covered:
                continue
            beacons.add(v)
            for u in nodes:
                if self.within(points[v], points[u], self.config.beacon_range) and self.clear(points[v], points[u]):
                    covered.add(u)
        return [v in beacons for v in nodes]

    def distances(self, source: int) -> list[float]:
        """Bellman and Ford's way: relax all edges until nothing changes."""
        number = {v: n for n, v in enumerate(self.nodes)}
        best = [inf] * len(self.nodes)
        best[source] = 0.0
        changed = True
        while changed:
            changed = False
            for v in self.nodes:
                for k, (dx, dy) in enumerate(NEIGHBOUR_OFFSETS.tolist()):
                    if self.all_edges[v] >> k & 1:
                        there = number[v[0] + dx, v[1] + dy]
                        length = best[number[v]] + hypot(dx, dy) * self.config.viewpoint_spacing
                        if length < best[there] - 1e-12:
                            best[there] = length
                            changed = True
        return best


def march(free: np.ndarray, resolution: float, pose: Pose, angle: float, range_max: float) -> float:
    """Range of one beam by small steps; accurate to about a thousandth of a cell."""
    steps = np.arange(0.0, range_max, resolution / 1000)
    columns = np.floor((pose.x + np.cos(angle) * steps) / resolution).astype(int)
    rows = np.floor((pose.y + np.sin(angle) * steps) / resolution).astype(int)
    inside = (rows >= 0) & (rows < free.shape[0]) & (columns >= 0) & (columns < free.shape[1])
    blocked = ~inside
    blocked[inside] = ~free[rows[inside], columns[inside]]
    return float(steps[np.argmax(blocked)]) if blocked.any() else inf


def full_turn(beams: int) -> float:
    return 2 * pi / beams
