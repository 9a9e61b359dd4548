"""The observation: one frozen, ragged, array-only record from the environment to the network.

Nothing is padded, stored or sent twice. Positions are whole lattice steps from the robot's viewpoint, so the same
record serves any resolution and viewpoint spacing. `ObservationBatch` is the columnar form that travels on the bus
and that the replay buffer holds.

Node numbers: viewpoints are 0 .. n - 1 in row-major order (by dy, then dx); in navigation the target is one more
node with number n. Beacons and waypoints, wherever they appear, are such node numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# The 20 neighbours of a viewpoint: the 5 x 5 block without its corners and its middle, row-major. Bit k of an edge
# mask is the edge to the viewpoint at NEIGHBOUR_OFFSETS[k] = (dx, dy) lattice steps. The list is point-symmetric:
# the reverse of bit k is bit 19 - k.
NEIGHBOUR_OFFSETS: NDArray[np.int16] = np.array(
    [(dx, dy) for dy in range(-2, 3) for dx in range(-2, 3) if (dx, dy) != (0, 0) and abs(dx) + abs(dy) < 4],
    dtype=np.int16,
)
NEIGHBOUR_COUNT = len(NEIGHBOUR_OFFSETS)

MAX_VIEWPOINTS = 20_000
MAX_TARGET_LINKS = 20
MAX_OFFSET = 4_000


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot knows when it decides: the viewpoint graph that it can reach and the planning set S_t.

    Attributes:
        offsets: (dx, dy) of each viewpoint in lattice steps from the robot's viewpoint, int16, shape (n, 2),
            row-major.
        utility: observable frontiers per viewpoint, uint16, shape (n,).
        visited: viewpoints where the robot has been, bool, shape (n,).
        beacon: viewpoints that stand for a group of useful ones (Algorithm 1), bool, shape (n,).
        edges: 20-bit masks over `NEIGHBOUR_OFFSETS`, uint32, shape (n,); symmetric.
        robot: node number of the robot's viewpoint.
        has_target: True in navigation; then node number n is the target.
        target_known: the target's cell is known to be free; the target then is a beacon too.
        target_offset: (dx, dy) of the target in lattice steps from the robot's viewpoint, float32, shape (2,);
            zeros without target.
        target_links: viewpoints tied to the target, uint16, shape (m,), m <= 20: those in line of sight once it is
            known, the beacons until then; empty without target.
    """

    offsets: NDArray[np.int16]
    utility: NDArray[np.uint16]
    visited: NDArray[np.bool_]
    beacon: NDArray[np.bool_]
    edges: NDArray[np.uint32]
    robot: int
    has_target: bool
    target_known: bool
    target_offset: NDArray[np.float32]
    target_links: NDArray[np.uint16]

    @property
    def viewpoints(self) -> int:
        """Number n of viewpoints, the target excluded."""
        return len(self.utility)

    @property
    def nodes(self) -> int:
        """Number of nodes, the target included."""
        return len(self.utility) + int(self.has_target)

    def beacon_nodes(self) -> NDArray[np.int64]:
        """Node numbers of all beacons, ascending; a known target is the last."""
        nodes = np.flatnonzero(self.beacon)
        return np.append(nodes, self.viewpoints) if self.target_known else nodes

    def waypoint_nodes(self) -> NDArray[np.int64]:
        """Node numbers that the robot can go to next: its neighbours in bit order, then a known target in sight."""
        bits = np.flatnonzero(self.edges[self.robot] >> _BIT_NUMBERS & 1)
        nodes = np.searchsorted(_keys(self.offsets), _NEIGHBOUR_KEYS[bits])
        if self.target_known and bool(np.any(self.target_links == self.robot)):
            nodes = np.append(nodes, self.viewpoints)
        return nodes


def _keys(offsets: NDArray[np.int16]) -> NDArray[np.int64]:
    wide = offsets.astype(np.int64)
    return wide[:, 1] * (4 * MAX_OFFSET) + wide[:, 0]


_BIT_NUMBERS = np.arange(NEIGHBOUR_COUNT, dtype=np.uint32)
_NEIGHBOUR_KEYS = _keys(NEIGHBOUR_OFFSETS)


@dataclass(frozen=True, slots=True, eq=False)
class ObservationBatch:
    """Several observations in columns: the arrays of all, one behind the other.

    Attributes:
        count: viewpoints per observation, int32, shape (k,).
        offsets: int16, shape (sum of count, 2).
        utility: uint16, shape (sum of count,).
        visited: bool, shape (sum of count,).
        beacon: bool, shape (sum of count,).
        edges: uint32, shape (sum of count,).
        robot: int32, shape (k,).
        has_target: bool, shape (k,).
        target_known: bool, shape (k,).
        target_offset: float32, shape (k, 2).
        link_count: target links per observation, int32, shape (k,).
        target_links: uint16, shape (sum of link_count,).
    """

    count: NDArray[np.int32]
    offsets: NDArray[np.int16]
    utility: NDArray[np.uint16]
    visited: NDArray[np.bool_]
    beacon: NDArray[np.bool_]
    edges: NDArray[np.uint32]
    robot: NDArray[np.int32]
    has_target: NDArray[np.bool_]
    target_known: NDArray[np.bool_]
    target_offset: NDArray[np.float32]
    link_count: NDArray[np.int32]
    target_links: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.count)

    @classmethod
    def stack(cls, observations: Sequence[Observation]) -> ObservationBatch:
        """Lay observations behind one another; at least one."""
        return cls(
            count=np.array([o.viewpoints for o in observations], dtype=np.int32),
            offsets=np.concatenate([o.offsets for o in observations]),
            utility=np.concatenate([o.utility for o in observations]),
            visited=np.concatenate([o.visited for o in observations]),
            beacon=np.concatenate([o.beacon for o in observations]),
            edges=np.concatenate([o.edges for o in observations]),
            robot=np.array([o.robot for o in observations], dtype=np.int32),
            has_target=np.array([o.has_target for o in observations], dtype=np.bool_),
            target_known=np.array([o.target_known for o in observations], dtype=np.bool_),
            target_offset=np.stack([o.target_offset for o in observations]),
            link_count=np.array([len(o.target_links) for o in observations], dtype=np.int32),
            target_links=np.concatenate([o.target_links for o in observations]),
        )

    def select(self, chosen: NDArray[np.bool_]) -> ObservationBatch:
        """Return a batch of the observations where ``chosen``, bool, shape (k,), is True, in their order."""
        rows = np.repeat(chosen, self.count)
        return ObservationBatch(
            count=self.count[chosen],
            offsets=self.offsets[rows],
            utility=self.utility[rows],
            visited=self.visited[rows],
            beacon=self.beacon[rows],
            edges=self.edges[rows],
            robot=self.robot[chosen],
            has_target=self.has_target[chosen],
            target_known=self.target_known[chosen],
            target_offset=self.target_offset[chosen],
            link_count=self.link_count[chosen],
            target_links=self.target_links[np.repeat(chosen, self.link_count)],
        )

    def __getitem__(self, index: int) -> Observation:
        """Return observation ``index`` as views into the columns."""
        first = int(self.count[:index].sum())
        last = first + int(self.count[index])
        link = int(self.link_count[:index].sum())
        return Observation(
            offsets=self.offsets[first:last],
            utility=self.utility[first:last],
            visited=self.visited[first:last],
            beacon=self.beacon[first:last],
            edges=self.edges[first:last],
            robot=int(self.robot[index]),
            has_target=bool(self.has_target[index]),
            target_known=bool(self.target_known[index]),
            target_offset=self.target_offset[index],
            target_links=self.target_links[link : link + int(self.link_count[index])],
        )
