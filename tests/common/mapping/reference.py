"""The mapping from scratch, slow and obvious: every step is computed from the definition, over all cells and pairs.

Cells are (row, column) numbers from the anchor and live in a dictionary; squares are lattice numbers (i, j). Points are
in 1/65536 cells from the anchor, as the mapping defines them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, lru_cache
from math import ceil, cos, floor, hypot, inf, isnan, pi, sin, sqrt

import numpy as np

from common.config import MappingConfig
from common.geometry import Pose, Scan

UNIT = 65536
FREE, OCCUPIED = 0, 100
TOLERANCE = 1e-3
Cell = tuple[int, int]
Point = tuple[int, int]
Square = tuple[int, int]


@dataclass(eq=False)
class Piece:
    """One connected part of the clear space inside a square."""

    square: Square
    cells: set[Cell]
    place: Point
    centred: bool
    waits: bool
    visited: bool = False
    lookout: bool = False
    touching: list[Piece] = field(default_factory=list)

    @property
    def order(self) -> tuple[int, int, Cell]:
        """Node numbers follow this."""
        return self.square[1], self.square[0], min(self.cells)


def middle(cell: Cell) -> Point:
    return cell[1] * UNIT + UNIT // 2, cell[0] * UNIT + UNIT // 2


def cell_of(point: Point) -> Cell:
    return point[1] // UNIT, point[0] // UNIT


def beside(cell: Cell) -> list[Cell]:
    row, column = cell
    return [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]


def flood(start: Cell, cells: set[Cell]) -> set[Cell]:
    """All cells that steps over common sides reach."""
    found, stack = {start}, [start]
    while stack:
        new = [cell for cell in beside(stack.pop()) if cell in cells and cell not in found]
        found.update(new)
        stack += new
    return found


@lru_cache(maxsize=200_000)
def touched_cells(a: Point, b: Point) -> list[Cell]:
    """All cells whose closed square meets the closed segment: boxes overlap, and no side of the line holds it all."""
    columns = np.arange((min(a[0], b[0]) - 1) // UNIT, max(a[0], b[0]) // UNIT + 2)
    rows = np.arange((min(a[1], b[1]) - 1) // UNIT, max(a[1], b[1]) // UNIT + 2)
    # On which side of the line each corner is: a cell's are its own and those of the next row and column.
    side = np.sign((b[0] - a[0]) * (rows[:, None] * UNIT - a[1]) - (b[1] - a[1]) * (columns * UNIT - a[0]))
    total = side[1:] + side[:-1]
    row, column = np.nonzero(np.abs(total[:, 1:] + total[:, :-1]) < 4)
    return list(zip((row + rows[0]).tolist(), (column + columns[0]).tolist(), strict=True))


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
        # Cells at whose viewpoints the robot has been.
        self.been: set[Cell] = set()
        self._sight: dict[tuple[Point, Point], bool] = {}
        # The lattice lies still: what was computed of it is kept.
        self._nearest = cache(self._nearest_number)
        self.cells_of = cache(self._cells_of)

    def point(self, position: tuple[float, float]) -> Point:
        return (
            round((position[0] - self.anchor[0]) / self.config.resolution * UNIT),
            round((position[1] - self.anchor[1]) / self.config.resolution * UNIT),
        )

    def lattice_point(self, square: Square) -> Point:
        spacing = self.config.viewpoint_spacing
        return self.point((self.lattice_origin[0] + spacing * square[0], self.lattice_origin[1] + spacing * square[1]))

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

    # -------------------------------------------------------------------------------------------------- clear space

    def frontiers(self) -> list[Cell]:
        """Free cells beside the unknown, for a robot with a radius those near a passage alone."""
        edge = sorted(
            (row, column)
            for (row, column), value in self.cells.items()
            if value == FREE
            and sum((row + up, column + right) not in self.cells for up in (-1, 0, 1) for right in (-1, 0, 1)) >= 2
        )
        if self.config.robot_radius == 0.0:
            return edge
        disc = self.disc(0.5)
        passages = {cell for cell in self.cells if self._passage(cell, disc)}
        return [
            (row, column) for row, column in edge if any((row + up, column + right) in passages for up, right in disc)
        ]

    def _passage(self, cell: Cell, disc: list[Cell]) -> bool:
        """Whether a robot could drive from a free cell into an unknown one beside it, by the walls that are known."""

        def fits(row: int, column: int) -> bool:
            return all(self.cells.get((row + up, column + right)) != OCCUPIED for up, right in disc)

        row, column = cell
        beside = [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
        return self.free(cell) and fits(*cell) and any(near not in self.cells and fits(*near) for near in beside)

    def disc(self, inside: float) -> list[Cell]:
        """Offsets of the cells that are nearer than the robot's radius, and of the cell itself; see `clear_cells`."""
        radius = self.config.robot_radius / self.config.resolution
        span = range(-ceil(radius) - 1, ceil(radius) + 2)
        return [
            (up, right)
            for up in span
            for right in span
            if (up, right) == (0, 0) or hypot(max(abs(up) - inside, 0), max(abs(right) - inside, 0)) < radius - 1e-9
        ]

    def clear_cells(self, inside: float) -> set[Cell]:
        """Free cells that no cell that is not free comes nearer to than the radius.

        Distances are those to the nearest point of the other cell: from the middle when ``inside`` is 0.5, from the
        nearest point of the cell itself when it is 1.
        """
        near = self.disc(inside)
        return {
            (row, column)
            for (row, column), value in self.cells.items()
            if value == FREE and all(self.free((row + up, column + right)) for up, right in near)
        }

    def square_of(self, cell: Cell) -> Square:
        x, y = middle(cell)
        return self._nearest(x, 0), self._nearest(y, 1)

    def _nearest_number(self, value: int, axis: int) -> int:
        """Number of the nearest lattice point along an axis, the higher of two equally near ones."""
        step = self.config.viewpoint_spacing / self.config.resolution * UNIT
        guess = floor((value - self.lattice_point((0, 0))[axis]) / step)
        return min(range(guess - 1, guess + 3), key=lambda k: (abs(self.lattice_point((k, k))[axis] - value), -k))

    def _cells_of(self, square: Square) -> list[Cell]:
        x, y = self.lattice_point(square)
        side = ceil(self.config.viewpoint_spacing / self.config.resolution) + 1
        return [
            (row, column)
            for row in range(y // UNIT - side, y // UNIT + side + 1)
            for column in range(x // UNIT - side, x // UNIT + side + 1)
            if self.square_of((row, column)) == square
        ]

    def margin(self, cell: Cell) -> int:
        """How many steps, king's moves, away space is blocked, at most half a metre's."""
        most = max(round(0.5 / self.config.resolution), 1)
        row, column = cell
        for steps in range(most):
            if any(
                (row + up, column + right) not in self.passable
                for up in range(-steps, steps + 1)
                for right in range(-steps, steps + 1)
            ):
                return steps
        return most

    def sees(self, a: Point, b: Point) -> bool:
        """Whether all cells that a segment touches are known to be free."""
        if (a, b) not in self._sight:
            self._sight[a, b] = all(self.free(cell) for cell in touched_cells(a, b))
        return self._sight[a, b]

    def drivable(self, a: Point, b: Point) -> bool:
        return all(cell in self.wide for cell in touched_cells(a, b))

    def distance(self, a: Point, b: Point) -> float:
        return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / UNIT * self.config.resolution

    def within(self, a: Point, b: Point, limit: float) -> bool:
        reach = round(limit / self.config.resolution * UNIT)
        return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 <= reach**2

    # ------------------------------------------------------------------------------------------------------- pieces

    def _find_pieces(self) -> list[Piece]:
        squares: dict[Square, set[Cell]] = {}
        for cell in self.passable:
            squares.setdefault(self.square_of(cell), set()).add(cell)
        pieces = []
        for square, cells in squares.items():
            known = [self.cells.get(cell) for cell in self.cells_of(square)]
            settled = OCCUPIED in known or None not in known
            centre = self.lattice_point(square)
            left = set(cells)
            while left:
                part = flood(min(left), left)
                left -= part
                centred = cell_of(centre) in part and self.drivable(centre, centre)
                place = centre if centred else self._best_place(part, centre)
                pieces.append(Piece(square, part, place, centred, not settled and not centred))
        pieces.sort(key=lambda piece: piece.order)
        self.piece_at = {cell: piece for piece in pieces for cell in piece.cells}
        for piece in pieces:
            piece.visited = not self.been.isdisjoint(piece.cells)
            others = {self.piece_at.get(there) for cell in piece.cells for there in beside(cell)}
            piece.touching = [other for other in others if other not in (None, piece)]
        return pieces

    def _best_place(self, cells: set[Cell], centre: Point) -> Point:
        """Most space around, then nearest to the centre, then the first."""

        def rank(cell: Cell) -> tuple[int, int, Cell]:
            x, y = middle(cell)
            return -self.margin(cell), (x - centre[0]) ** 2 + (y - centre[1]) ** 2, cell

        return middle(min(cells, key=rank))

    @property
    def clear_reach(self) -> int:
        """How far beside clear space a robot or a frontier may be, cells."""
        return ceil((self.config.robot_radius + 0.5) / self.config.resolution)

    def cell_for(self, point: Point) -> Cell | None:
        """The clear cell that stands for a point: the one that holds it, else the nearest that it can be driven to.

        A point on a border belongs to the lower cell. The straight line to the nearest cell is free; those are
        preferred to which it comes no nearer to anything that is not free than the point is, and where there is none of
        them, one that is reached over other cells, as near to anything as the point at most.
        """
        cell = cell_of((point[0] - 1, point[1] - 1))
        if cell in self.piece_at:
            return cell
        reach = self.clear_reach
        row, column = cell_of(point)
        around = [
            (there_row, there_column)
            for there_row in range(row - reach, row + reach + 1)
            for there_column in range(column - reach, column + reach + 1)
        ]
        seen = [cell for cell in around if cell in self.passable and self.sees(point, middle(cell))]
        before = self.space_around(point, point, reach)

        def keeps(a: Point, b: Point) -> bool:
            return self.space_around(a, b, reach) >= before - 1e-4

        def far(cell: Cell) -> tuple[int, Cell]:
            x, y = middle(cell)
            return (x - point[0]) ** 2 + (y - point[1]) ** 2, cell

        kept = [cell for cell in seen if keeps(point, middle(cell))]
        if kept:
            return min(kept, key=far)
        beginning = [cell for cell in around if max(abs(cell[0] - row), abs(cell[1] - column)) <= 2]
        reached = [cell for cell in beginning if self.sees(point, middle(cell)) and keeps(point, middle(cell))]
        for cell in reached:
            if cell in self.passable:
                return cell
            up, down, right, left = beside(cell)
            reached += [
                there
                for there in (down, left, right, up)
                if there in around and there not in reached and self.free(there) and keeps(middle(there), middle(there))
            ]
        return min(seen, key=far) if seen else None

    def space_around(self, a: Point, b: Point, most: float) -> float:
        """Distance of a segment from the nearest cell that is not free, cells, at most ``most``."""
        (row, column), span = cell_of(a), 2 * ceil(most) + 2
        blocked = [
            (there_column, there_row)
            for there_row in range(row - span, row + span + 1)
            for there_column in range(column - span, column + span + 1)
            if not self.free((there_row, there_column))
        ]
        if not blocked:
            return most
        low = np.array(blocked, dtype=float)
        start, end = np.array(a) / UNIT, np.array(b) / UNIT

        def gap(part: np.ndarray) -> np.ndarray:
            point = start + part[:, None] * (end - start)
            return np.hypot(*np.maximum(np.maximum(low - point, point - low - 1.0), 0.0).T)

        # The distance of a point on a line from a convex body has one minimum: part the segment until it is found.
        left, right = np.zeros(len(low)), np.ones(len(low))
        for _ in range(60):
            third = (right - left) / 3
            nearer = gap(left + third) < gap(right - third)
            right = np.where(nearer, right - third, right)
            left = np.where(nearer, left, left + third)
        return min(float(gap((left + right) / 2).min()), most)

    def piece_of(self, point: Point) -> Piece | None:
        cell = self.cell_for(point)
        return None if cell is None else self.piece_at[cell]

    def _move_to_lookouts(self, groups: list[list[Cell]], pieces: list[Piece]) -> None:
        """Let the viewpoint of each piece stand at the clear cell that is nearest to a frontier, unless that is known.

        A frontier belongs to the nearest clear cell that sees it, and to those of the cells around it that see it, too.
        A cell that observes too few frontiers to be useful is passed over, unless they are all that a gap shows.
        """
        reach = self.clear_reach
        nearest: dict[Piece, tuple[int, Cell]] = {}
        for row, column in (group[0] for group in groups):
            near = [
                (up**2 + right**2, (row + up, column + right))
                for up in range(-reach - 1, reach + 2)
                for right in range(-reach - 1, reach + 2)
                if (row + up, column + right) in self.passable
                and self.sees(middle((row, column)), middle((row + up, column + right)))
            ]
            inside = [(far, place) for far, place in near if max(abs(place[0] - row), abs(place[1] - column)) <= reach]
            if not inside or self._has_been(min(inside)[1]):
                continue
            first = min(inside)[1]
            for far, place in near:
                if (
                    max(abs(place[k] - first[k]) for k in (0, 1)) <= 1
                    and self.piece_at[place] in pieces
                    and not self._has_been(place)
                    and (
                        self._in_gap((row, column))
                        or self._observed_from(middle(place), groups) >= self.config.least_utility
                    )
                ):
                    piece = self.piece_at[place]
                    nearest[piece] = min(nearest.get(piece, (far, place)), (far, place))
        for piece, (_, cell) in nearest.items():
            piece.place, piece.lookout = middle(cell), True

    def _in_gap(self, cell: Cell) -> bool:
        """Whether a frontier that the robot fits in has a wall on one side, nothing free on both, unknown ahead."""
        up, down, right, left = (self.cells.get(there) for there in beside(cell))
        return cell in self.passable and any(
            FREE not in sides and OCCUPIED in sides and None in ends
            for sides, ends in (((up, down), (left, right)), ((left, right), (up, down)))
        )

    def _has_been(self, place: Cell) -> bool:
        """Whether the robot has been near a place, in sight of it."""
        known = max(round(0.3 / self.config.resolution), 1)
        return any(
            max(abs(place[k] - cell[k]) for k in (0, 1)) <= known and self.sees(middle(cell), middle(place))
            for cell in self.been
        )

    # -------------------------------------------------------------------------------------------------- observation

    def update(self, pose: Pose) -> None:
        """Compute everything anew; results are attributes, those of the graph only when the robot is in it."""
        self._sight.clear()
        self.passable, self.wide = self.clear_cells(0.5), self.clear_cells(1.0)
        self.all_frontiers = self.frontiers()
        self.pieces = self._find_pieces()
        here = self.point(pose.position)
        usual = {piece: piece.place for piece in self.pieces}
        self.robot = self.piece_of(here)
        if self.robot is not None and (
            not self.robot.visited and self.distance(self.robot.place, here) <= self.config.viewpoint_spacing / 2 + 1e-9
        ):
            self.robot.visited = True
            self.been.add(cell_of(self.robot.place))
        self.viewpoints = [
            piece
            for piece in self.pieces
            if not piece.waits or piece.visited or piece is self.robot or any(p.visited for p in piece.touching)
        ]
        side = max(floor(0.25 / self.config.resolution + 0.5), 1)
        self._group(side)
        if self.robot is None:
            return
        self._connect()
        self._look_around(here, usual)
        if self.nothing_left and side > 1:
            self._group(1)
            self._look_around(here, usual)
        if self.nothing_left:
            self.been.add(self.cell_for(here))
            self.robot.visited = True
            for piece in self.pieces:
                piece.place, piece.lookout = usual[piece], False
            self._group(1)
            self._move_to_lookouts(self.groups, self.pieces)
            self.viewpoints = self.pieces
            self._count()
            self._connect()
        self._observe()

    def _look_around(self, here: Point, usual: dict[Piece, Point]) -> None:
        """Let pieces where the robot has been look past corners that nobody else will show; find what is left."""
        if self.config.robot_radius > 0.0:
            assert self.robot is not None
            if self.robot.visited:
                cell = self.cell_for(here)
                assert cell is not None
                self.been.add(cell)
            for piece in self.pieces:
                piece.place, piece.lookout = usual[piece], False
            new = [piece.place for piece in self.nodes if not piece.visited]
            overlooked = [
                group for group in self.groups if not any(self._observed_from(place, [group]) for place in new)
            ]
            self._move_to_lookouts(overlooked, [piece for piece in self.viewpoints if piece.visited])
            self._count()
            self._connect()
        self.nothing_left = not any(
            self.counts[piece] >= self.config.least_utility and (not piece.visited or piece.lookout)
            for piece in self.nodes
        )

    def _group(self, side: int) -> None:
        """Let the first frontier cell of each block of so many by so many cells stand for all of them."""
        blocks: dict[Cell, list[Cell]] = {}
        for cell in sorted(self.all_frontiers):
            blocks.setdefault((cell[0] // side, cell[1] // side), []).append(cell)
        self.groups = list(blocks.values())
        self._count()

    def _count(self) -> None:
        """The frontiers that viewpoints observe."""
        self.counts = {piece: self._observed_from(piece.place, self.groups) for piece in self.viewpoints}

    def _observed_from(self, place: Point, groups: list[list[Cell]]) -> int:
        reach = self.config.observable_range
        return sum(
            len(group)
            for group in groups
            if self.within(place, middle(group[0]), reach) and self.sees(place, middle(group[0]))
        )

    def _connect(self) -> None:
        """Straight edges and bent ones, and the viewpoints that they connect with the robot's."""
        viewpoints = self.viewpoints
        longest = sqrt(5) * self.config.viewpoint_spacing + 1e-4 * self.config.resolution
        self.straight = {
            (a, b)
            for a in viewpoints
            for b in viewpoints
            if a is not b
            and max(abs(a.square[k] - b.square[k]) for k in (0, 1)) <= 2
            and self.distance(a.place, b.place) <= longest
            and self.drivable(a.place, b.place)
        }
        chosen = set(viewpoints)
        self.bent = {(a, b) for a in viewpoints for b in a.touching if b in chosen and (a, b) not in self.straight}
        neighbours: dict[Piece, list[Piece]] = {}
        for a, b in self.straight | self.bent:
            neighbours.setdefault(a, []).append(b)
        assert self.robot is not None
        found, stack = {self.robot}, [self.robot]
        while stack:
            new = [piece for piece in neighbours.get(stack.pop(), []) if piece not in found]
            found.update(new)
            stack += new
        self.nodes = sorted(found, key=lambda piece: piece.order)

    def _observe(self) -> None:
        config, nodes = self.config, self.nodes
        counts = [self.counts[piece] for piece in nodes]
        threshold = config.min_utility if max(counts) >= config.min_utility else config.least_utility
        self.utility = [
            count if count >= min(threshold, config.min_utility) or piece.lookout else 0
            for count, piece in zip(counts, nodes, strict=True)
        ]
        self.beacon = self._beacons()
        self.links: list[int] = []
        self.target_known = False
        if self.target is None:
            return
        goal = self.point(self.target)
        far = [(self.distance(piece.place, goal), n) for n, piece in enumerate(nodes)]
        choice: list[int] = []
        if self.free(cell_of(goal)):
            reach = sqrt(5) * config.viewpoint_spacing + 1e-4 * config.resolution
            choice = [n for d, n in far if d <= reach and self.drivable(goal, nodes[n].place)]
            if not choice:
                piece = self.piece_of(goal)
                choice = [nodes.index(piece)] if piece in nodes else []
        self.target_known = bool(choice)
        choice = choice or [n for n in range(len(nodes)) if self.beacon[n]]
        self.links = sorted(sorted(choice, key=lambda n: far[n])[:20])

    def _beacons(self) -> list[bool]:
        """Algorithm 1."""
        covered: set[Piece] = set()
        beacons = set()
        for piece, useful in zip(self.nodes, self.utility, strict=True):
            if not useful or piece in covered:
                continue
            beacons.add(piece)
            for other in self.nodes:
                if self.within(piece.place, other.place, self.config.beacon_range) and self.sees(
                    piece.place, other.place
                ):
                    covered.add(other)
        return [piece in beacons for piece in self.nodes]


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
