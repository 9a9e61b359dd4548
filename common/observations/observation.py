"""The observation: one frozen, ragged, array-only record from the environment to the network.

Nothing is padded, stored or sent twice. Positions are lattice steps from the robot's viewpoint, in fixed point, so the
same record serves any resolution and viewpoint spacing, and turns and mirrorings of it are exact. `ObservationBatch` is
the columnar form that travels on the bus and that the replay buffer holds.

Node numbers: viewpoints are 0 .. n - 1, row-major by their lattice square, those of one square in a row; in navigation
the target is one more node with number n. Beacons and waypoints, wherever they appear, are such node numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# k of the paper: on a lattice, the neighbours within sqrt(5) steps are the 20 nearest.
NEIGHBOUR_COUNT = 20
# Offsets count this many to a lattice step.
STEP_UNITS = 64

MAX_VIEWPOINTS = 20_000
MAX_DEGREE = 255
MAX_EDGES = MAX_VIEWPOINTS * MAX_DEGREE // 2
MAX_TARGET_LINKS = 20
# Lattice steps: 500 * 64 fits into int16.
MAX_OFFSET = 500
# Nodes of a reference route.
MAX_ROUTE = 255
# An image's side in pixels, and which images there are: the surroundings of the robot, and all around it.
IMAGE_SIDE = 48
IMAGES = ("near", "far")
# Lattice steps: no edge leads out of two neighbouring squares, whose cells a winding way can fill.
MAX_EDGE_LENGTH = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot knows when it decides: the viewpoint graph that it can reach and the planning set S_t.

    Attributes:
        offsets: (dx, dy) of each viewpoint from the robot's viewpoint in 1/64 lattice steps (`STEP_UNITS`), int16,
            shape (n, 2).
        utility: observable frontiers per viewpoint, uint16, shape (n,).
        visited: viewpoints where the robot has been, bool, shape (n,).
        beacon: viewpoints that stand for a group of useful ones (Algorithm 1), bool, shape (n,).
        degree: number of neighbours with a higher node number, uint8, shape (n,).
        neighbours: those neighbours, ascending, of one viewpoint behind the other's, uint16, shape (e,); so each of
            the e edges stands here once.
        bent: edges (indices into `neighbours`) whose way is not the straight line, ascending, uint32, shape (b,).
        bent_length: lengths of their ways in lattice steps, float32, shape (b,).
        robot: node number of the robot's viewpoint.
        has_target: True in navigation; then node number n is the target.
        target_known: the target's cell is known to be free; the target then is a beacon too.
        target_offset: (dx, dy) of the target in lattice steps from the robot's viewpoint, float32, shape (2,);
            zeros without target.
        target_links: viewpoints tied to the target, uint16, shape (m,), m <= 20: those in line of sight once it is
            known, the beacons until then; empty without target.
        cell: side of a belief cell in lattice steps; a viewpoint's utility times this is a length of frontier.
        reach: range of the sensor in lattice steps.
        route: viewpoints along the reference route, in its order, the robot's left out, uint16, shape (r,), r <= 255:
            where a classical planner would go, see `common.planners.reference`; empty where nobody was asked.
        image: the belief around the robot as `IMAGES`, uint8, shape (2, side * side), see
            `common.mapping.occupancy_image`; None for networks that read none.
    """

    offsets: NDArray[np.int16]
    utility: NDArray[np.uint16]
    visited: NDArray[np.bool_]
    beacon: NDArray[np.bool_]
    degree: NDArray[np.uint8]
    neighbours: NDArray[np.uint16]
    bent: NDArray[np.uint32]
    bent_length: NDArray[np.float32]
    robot: int
    has_target: bool
    target_known: bool
    target_offset: NDArray[np.float32]
    target_links: NDArray[np.uint16]
    cell: float
    reach: float
    route: NDArray[np.uint16]
    image: NDArray[np.uint8] | None = None

    @property
    def viewpoints(self) -> int:
        """Number n of viewpoints, the target excluded."""
        return len(self.utility)

    @property
    def nodes(self) -> int:
        """Number of nodes, the target included."""
        return len(self.utility) + int(self.has_target)

    @property
    def steps(self) -> NDArray[np.float64]:
        """Offsets of all nodes in lattice steps, the target's last, shape (nodes, 2)."""
        steps = self.offsets / STEP_UNITS
        return np.concatenate([steps, self.target_offset[None].astype(np.float64)]) if self.has_target else steps

    def beacon_nodes(self) -> NDArray[np.int64]:
        """Node numbers of all beacons, ascending; a known target is the last."""
        nodes = np.flatnonzero(self.beacon)
        return np.append(nodes, self.viewpoints) if self.target_known else nodes

    def waypoint_nodes(self) -> NDArray[np.int64]:
        """Node numbers that the robot can go to next: its neighbours, ascending, then a known target in sight."""
        ends = np.cumsum(self.degree, dtype=np.int64)
        # Lower neighbours list the robot; higher ones are listed by it.
        lower = np.searchsorted(ends, np.flatnonzero(self.neighbours == self.robot), side="right")
        end = int(ends[self.robot])
        higher = self.neighbours[end - int(self.degree[self.robot]) : end]
        nodes = np.concatenate([lower, higher.astype(np.int64)])
        if self.target_known and bool(np.any(self.target_links == self.robot)):
            nodes = np.append(nodes, self.viewpoints)
        return nodes


@dataclass(frozen=True, slots=True, eq=False)
class ObservationBatch:
    """Several observations in columns: the arrays of all, one behind the other.

    Attributes:
        count: viewpoints per observation, int32, shape (k,).
        offsets: int16, shape (sum of count, 2).
        utility: uint16, shape (sum of count,).
        visited: bool, shape (sum of count,).
        beacon: bool, shape (sum of count,).
        degree: uint8, shape (sum of count,).
        edge_count: edges per observation, int32, shape (k,); the sum of its degrees.
        neighbours: node numbers within their observation, uint16, shape (sum of edge_count,).
        bent_count: bent edges per observation, int32, shape (k,).
        bent: indices into the neighbours of their observation, uint32, shape (sum of bent_count,).
        bent_length: float32, shape (sum of bent_count,).
        robot: int32, shape (k,).
        has_target: bool, shape (k,).
        target_known: bool, shape (k,).
        target_offset: float32, shape (k, 2).
        link_count: target links per observation, int32, shape (k,).
        target_links: uint16, shape (sum of link_count,).
        cell: float32, shape (k,).
        reach: float32, shape (k,).
        route_count: viewpoints on the route of each observation, int32, shape (k,).
        route: uint16, shape (sum of route_count,).
        image: uint8, shape (k, 2, side * side), or None.
    """

    count: NDArray[np.int32]
    offsets: NDArray[np.int16]
    utility: NDArray[np.uint16]
    visited: NDArray[np.bool_]
    beacon: NDArray[np.bool_]
    degree: NDArray[np.uint8]
    edge_count: NDArray[np.int32]
    neighbours: NDArray[np.uint16]
    bent_count: NDArray[np.int32]
    bent: NDArray[np.uint32]
    bent_length: NDArray[np.float32]
    robot: NDArray[np.int32]
    has_target: NDArray[np.bool_]
    target_known: NDArray[np.bool_]
    target_offset: NDArray[np.float32]
    link_count: NDArray[np.int32]
    target_links: NDArray[np.uint16]
    cell: NDArray[np.float32]
    reach: NDArray[np.float32]
    route_count: NDArray[np.int32]
    route: NDArray[np.uint16]
    image: NDArray[np.uint8] | None = None

    def __len__(self) -> int:
        return len(self.count)

    @classmethod
    def stack(cls, observations: Sequence[Observation]) -> ObservationBatch:
        """Lay observations behind one another; at least one.

        Raises:
            ValueError: some have an image and some have none.
        """
        images = [o.image for o in observations if o.image is not None]
        if images and len(images) < len(observations):
            raise ValueError(
                f"all observations of a batch have an image or none has: {len(images)} of {len(observations)}"
            )
        return cls(
            count=np.array([o.viewpoints for o in observations], dtype=np.int32),
            offsets=np.concatenate([o.offsets for o in observations]),
            utility=np.concatenate([o.utility for o in observations]),
            visited=np.concatenate([o.visited for o in observations]),
            beacon=np.concatenate([o.beacon for o in observations]),
            degree=np.concatenate([o.degree for o in observations]),
            edge_count=np.array([len(o.neighbours) for o in observations], dtype=np.int32),
            neighbours=np.concatenate([o.neighbours for o in observations]),
            bent_count=np.array([len(o.bent) for o in observations], dtype=np.int32),
            bent=np.concatenate([o.bent for o in observations]),
            bent_length=np.concatenate([o.bent_length for o in observations]),
            robot=np.array([o.robot for o in observations], dtype=np.int32),
            has_target=np.array([o.has_target for o in observations], dtype=np.bool_),
            target_known=np.array([o.target_known for o in observations], dtype=np.bool_),
            target_offset=np.stack([o.target_offset for o in observations]),
            link_count=np.array([len(o.target_links) for o in observations], dtype=np.int32),
            target_links=np.concatenate([o.target_links for o in observations]),
            cell=np.array([o.cell for o in observations], dtype=np.float32),
            reach=np.array([o.reach for o in observations], dtype=np.float32),
            route_count=np.array([len(o.route) for o in observations], dtype=np.int32),
            route=np.concatenate([o.route for o in observations]),
            image=np.stack(images) if images else None,
        )

    def select(self, chosen: NDArray[np.bool_]) -> ObservationBatch:
        """Return a batch of the observations where ``chosen``, bool, shape (k,), is True, in their order."""
        rows = np.repeat(chosen, self.count)
        bent = np.repeat(chosen, self.bent_count)
        return ObservationBatch(
            count=self.count[chosen],
            offsets=self.offsets[rows],
            utility=self.utility[rows],
            visited=self.visited[rows],
            beacon=self.beacon[rows],
            degree=self.degree[rows],
            edge_count=self.edge_count[chosen],
            neighbours=self.neighbours[np.repeat(chosen, self.edge_count)],
            bent_count=self.bent_count[chosen],
            bent=self.bent[bent],
            bent_length=self.bent_length[bent],
            robot=self.robot[chosen],
            has_target=self.has_target[chosen],
            target_known=self.target_known[chosen],
            target_offset=self.target_offset[chosen],
            link_count=self.link_count[chosen],
            target_links=self.target_links[np.repeat(chosen, self.link_count)],
            cell=self.cell[chosen],
            reach=self.reach[chosen],
            route_count=self.route_count[chosen],
            route=self.route[np.repeat(chosen, self.route_count)],
            image=None if self.image is None else self.image[chosen],
        )

    def __getitem__(self, index: int) -> Observation:
        """Return observation ``index`` as views into the columns."""

        def part(count: NDArray[np.int32]) -> slice:
            first = int(count[:index].sum())
            return slice(first, first + int(count[index]))

        rows, bent = part(self.count), part(self.bent_count)
        return Observation(
            offsets=self.offsets[rows],
            utility=self.utility[rows],
            visited=self.visited[rows],
            beacon=self.beacon[rows],
            degree=self.degree[rows],
            neighbours=self.neighbours[part(self.edge_count)],
            bent=self.bent[bent],
            bent_length=self.bent_length[bent],
            robot=int(self.robot[index]),
            has_target=bool(self.has_target[index]),
            target_known=bool(self.target_known[index]),
            target_offset=self.target_offset[index],
            target_links=self.target_links[part(self.link_count)],
            cell=float(self.cell[index]),
            reach=float(self.reach[index]),
            route=self.route[part(self.route_count)],
            image=None if self.image is None else self.image[index],
        )
