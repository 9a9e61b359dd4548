"""The mapper: scans and poses in, the observation of the paper's planning problem out."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import MappingError
from common.geometry import Pose, Scan
from common.mapping.adjacency import Adjacency
from common.mapping.belief import Belief
from common.mapping.frontiers import FrontierChanges, Frontiers
from common.mapping.lookouts import Remains
from common.mapping.map_view import MapView
from common.mapping.pieces import NOWHERE
from common.mapping.planning_set import Frame, anything_left, plan
from common.mapping.raycast import SUBCELLS
from common.mapping.retreat import corners_back, find_back
from common.mapping.sight import NOTHING_LOST
from common.mapping.target import Target
from common.mapping.thinning import cells_a_block
from common.mapping.track import Track
from common.mapping.utility import FrontierUtility
from common.mapping.viewpoints import ViewpointGraph
from common.observations.observation import MAX_VIEWPOINTS, Observation

# Positions lie so near to the lattice's origin along each axis, metres: in subcells they must fit into 64 bits.
FARTHEST: Final = 1.0e6
_NO_NODES: Final = np.empty(0, dtype=np.int32)
_NO_ROUTE: Final = np.empty(0, dtype=np.uint16)
_NO_EDGES: Final = Adjacency(np.zeros(1, np.int64), _NO_NODES, np.empty(0), np.empty(0, np.bool_))
_NO_CHANGES: Final = FrontierChanges(_NO_NODES, _NO_NODES, NOTHING_LOST)


class Mapper(MapView):
    """What one robot knows, and the graph that it plans on; the same in simulation and on the robot.

    Usage::

        mapper = Mapper(config.mapping, lattice_origin=world.lattice_origin)
        mapper.integrate(scan, pose)  # any number of times
        mapper.update(pose)
        observation = mapper.observe()
        waypoint = mapper.position(node)

    `update` recomputes only what the changes of the belief since the last update can have touched; the result is
    the same as if everything were computed from the belief alone. Node numbers are those of the last update.

    Attributes:
        belief: the grid; it grows by itself when a scan reaches outside.
        frontiers_removed: frontier cells that updates have found to be frontiers no more, since the start; it only
            rises, so that differences tell what a step achieved.
    """

    # Looks at each frontier, once the one that looks at one of a block finds nothing left.
    _exact: FrontierUtility | None

    def __init__(
        self,
        config: MappingConfig,
        *,
        lattice_origin: tuple[float, float],
        bounds: tuple[float, float, float, float] | None = None,
        target: tuple[float, float] | None = None,
    ) -> None:
        """Start with an unknown belief.

        Args:
            config: resolution, ranges, spacing and the robot's radius.
            lattice_origin: (x, y) of one point of the viewpoint lattice, metres.
            bounds: x_min, y_min, x_max, y_max that are allocated at first, metres; nothing when not given.
            target: (x, y) of the navigation target, metres.

        Raises:
            MappingError: a position is not finite or too far away, or the bounds are empty.
        """
        if not np.isfinite(lattice_origin).all():
            raise MappingError(f"lattice_origin must be finite, got {lattice_origin}: pass (x, y) in metres")
        if target is not None:
            _check_near("target", target, lattice_origin)
        self.belief = Belief(config.resolution, config.sensor_range, anchor=lattice_origin, bounds=bounds)
        self.frontiers_removed = 0
        self._config = config
        # Without a radius, frontiers are holes in walls, too, and nobody should look past every corner.
        self._thorough = config.robot_radius > 0.0
        self._lattice_origin = lattice_origin
        self._observable_reach = round(config.observable_range / config.resolution * SUBCELLS)
        self._beacon_reach = round(config.beacon_range / config.resolution * SUBCELLS)
        self.target = target
        self._pose: Pose | None = None
        self._track = Track(config.resolution)
        self._back = []
        self._cut_off = None
        self._rebuild(None)
        self._forget_nodes()

    def integrate(self, scan: Scan, pose: Pose) -> int:
        """Add a scan to the belief and return the number of cells that became known; see `Belief.integrate`."""
        known = self.belief.integrate(scan, pose)
        self.passed(pose)
        return known

    def passed(self, pose: Pose) -> None:
        """Note where the robot has been, for those who write the belief themselves; `integrate` does it, too."""
        self._track.add(pose.position)

    def update(self, pose: Pose) -> None:
        """Bring frontiers, viewpoints, edges, utilities, beacons, visited flags and the robot's node up to date.

        A viewpoint counts as visited when it is the robot's node and within half a spacing, or once nothing else is
        left to look at. One that has moved to a lookout counts as not visited.

        A robot can come to stand in clear space that later turns out to be cut off: a gap that it has passed is too
        narrow by its map. When nothing is left to see where it can get to from there, it counts as standing where it
        came from, if there is more to see, and `way_home` leads back along its track; `cut_off` tells of a closed way.

        Raises:
            MappingError: the pose is not finite or too far away, or more viewpoints are reachable than an observation
                can hold.
        """
        _check_near("a pose", pose.position, self._lattice_origin)
        belief = self.belief
        if belief.generation != self._generation:
            self._rebuild(self._graph)
        changed = belief.take_changes()
        frontiers = _NO_CHANGES
        if changed is not None:
            graph = self._graph
            frontiers = self._frontiers.update(belief.padded, changed, graph.layout, graph.dirty, graph.beside)
            self.frontiers_removed += len(frontiers.removed)
        robot = belief.subcells(pose.position)
        self._graph.update(changed, frontiers.lost, robot, stay=self._thorough)
        self._update_utility(frontiers)
        self._pose = pose
        self._back = []
        self._cut_off = None
        if self._graph.robot < 0:
            self._utility = self._thinned
            self._forget_nodes()
            return
        left = self._survey(robot)
        if not left:
            place = self._go_back()
            if place is not None:
                robot = place
                self._graph.update(None, NOTHING_LOST, robot, stay=self._thorough)
                self._update_utility(_NO_CHANGES)
                left = self._survey(robot)
        if not left:
            every = self._frontiers.flat.astype(np.int32)
            self._look_around(every, np.ones_like(every), robot, everywhere=True)
        self._plan()

    @property
    def target(self) -> tuple[float, float] | None:
        """(x, y) of the navigation target, metres, or None; another one counts from the next `update`."""
        return None if self._target is None else self._target.position

    @target.setter
    def target(self, position: tuple[float, float] | None) -> None:
        if position is not None:
            _check_near("target", position, self._lattice_origin)
        self._target = None if position is None else Target(position, self._config)

    def _rebuild(self, previous: ViewpointGraph | None) -> None:
        """Start over on a reallocated belief: all of it counts as changed."""
        config = self._config
        self._generation = self.belief.generation
        self._origin = np.array(self.belief.origin)
        self._frontiers = Frontiers(self.belief, config.robot_radius)
        self._graph = ViewpointGraph(
            self.belief, self._lattice_origin, config.viewpoint_spacing, config.robot_radius, previous
        )
        self._utility = self._thinned = self._new_utility(cells_a_block(config.resolution))
        self._exact = None
        self._frame = Frame(
            *self._lattice_origin, *self._graph.first, config.viewpoint_spacing, *self.belief.origin, config.resolution
        )

    def _new_utility(self, side: int) -> FrontierUtility:
        return FrontierUtility(self.belief, self._frontiers, self._graph, self._config, side=side)

    def _survey(self, robot: tuple[int, int]) -> bool:
        """Number the viewpoints that the robot can get to, and return whether anything is left to see from them."""
        self._order, self._numbers, self._edges = self._graph.reachable()
        self._utility = self._thinned
        left = self._anything_left(robot)
        if left:
            self._exact = None
        elif self._thinned.side > 1:
            # A viewpoint that shows none of the frontiers that stand for others may still show those.
            if self._exact is None:
                self._exact = self._new_utility(1)
                everything = FrontierChanges(self._frontiers.flat.astype(np.int32), _NO_NODES, NOTHING_LOST)
                self._exact.update(self.belief.padded.reshape(-1), everything)
            self._utility = self._exact
            left = self._anything_left(robot)
        return left

    def _go_back(self) -> tuple[int, int] | None:
        """Return where on its track the robot counts as standing, subcells; mostly None.

        The way there is noted in ``_back``, or in ``_cut_off`` that it is closed.
        """
        graph = self._graph
        places = self._subcells(self._track.places)
        target = NOWHERE if self.target is None else graph.piece_of(self.belief.subcells(self.target))
        found = find_back(graph, places, self._numbers, self._thinned.counts, self._config.least_utility, target)
        if found is None:
            return None
        self._plan()
        if self.target_known:
            return None
        x, y = self._track.places[found.oldest].tolist()
        if found.closed:
            self._cut_off = x, y
            return None
        assert self._pose is not None
        self._back = corners_back(self, self._pose.position, self._track, found)
        return self.belief.subcells((x, y))

    def _anything_left(self, robot: tuple[int, int]) -> bool:
        """Return whether a viewpoint where the robot has not been observes enough; one beside a frontier may move."""
        if self._thorough:
            self._look_around(*self._utility.overlooked(self._numbers), robot)
        left: bool = anything_left(self._order, self._graph.pieces, self._utility.counts, self._config.least_utility)
        return left

    def _look_around(
        self,
        frontiers: NDArray[np.int32],
        weights: NDArray[np.int32],
        robot: tuple[int, int],
        *,
        everywhere: bool = False,
    ) -> None:
        """Move viewpoints to lookouts beside frontiers, see `ViewpointGraph.update`, and all others back."""
        remains = Remains(frontiers, weights, self._observable_reach, self._config.least_utility)
        self._graph.update(None, NOTHING_LOST, robot, remains=remains, everywhere=everywhere)
        if len(self._graph.fresh) or len(self._graph.ended):
            self._update_utility(_NO_CHANGES)
            self._order, self._numbers, self._edges = self._graph.reachable()

    def _update_utility(self, frontiers: FrontierChanges) -> None:
        cells = self.belief.padded.reshape(-1)
        self._thinned.update(cells, frontiers)
        if self._exact is not None:
            self._exact.update(cells, frontiers)

    def _plan(self) -> None:
        """Number the nodes, collect the planning set and choose the beacons."""
        graph, config = self._graph, self._config
        if len(self._order) > MAX_VIEWPOINTS:
            raise MappingError(
                f"{len(self._order)} viewpoints are reachable, an observation holds {MAX_VIEWPOINTS}: "
                "raise mapping.viewpoint_spacing"
            )
        self._robot = int(self._numbers[graph.robot])
        known = plan(
            self._order, graph.pieces, graph.layout, self._utility.counts, config.min_utility, config.least_utility,
            self._robot, self._frame, self.belief.padded, self._beacon_reach, self._edges,
        )  # fmt: skip
        self._positions = known.positions
        target = self._target
        if target is not None:
            target.tie(self.belief, graph, self._numbers, known.x, known.y, known.beacon)
            links, offset = target.links.astype(np.uint16), target.offset(self.position(self._robot))
        else:
            links, offset = np.empty(0, dtype=np.uint16), np.zeros(2, dtype=np.float32)
        self._observation = Observation(
            offsets=known.offsets,
            utility=known.utility,
            visited=known.visited,
            beacon=known.beacon,
            degree=known.degree,
            neighbours=known.neighbours,
            bent=known.bent,
            bent_length=known.bent_length,
            robot=self._robot,
            has_target=target is not None,
            target_known=target is not None and target.known,
            target_offset=offset,
            target_links=links,
            cell=config.resolution / config.viewpoint_spacing,
            reach=config.sensor_range / config.viewpoint_spacing,
            route=_NO_ROUTE,
        )

    def _forget_nodes(self) -> None:
        self._robot = -1
        self._order = _NO_NODES
        self._numbers = np.full(self._graph.used, -1, dtype=np.int32)
        self._edges = _NO_EDGES
        self._positions = np.empty((0, 2))
        if self._target is not None:
            self._target.forget()


def _check_near(name: str, position: tuple[float, float], origin: tuple[float, float]) -> None:
    """Raise a MappingError unless a position is one that subcells can say."""
    # Written so that NaN is not near.
    if not all(abs(value - middle) <= FARTHEST for value, middle in zip(position, origin, strict=True)):
        raise MappingError(
            f"{name} must be finite and within {FARTHEST / 1000:g} km of the lattice's origin {origin}, got "
            f"{position}: check the map frame and the robot's localisation"
        )
