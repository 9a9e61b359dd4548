"""A covering tour over the frontiers: which viewpoints together see them all, and the shortest way through these."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.config import MappingConfig
from common.errors import ConfigError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.planners.base import Position, TaskName
from common.planners.exploration.clusters import cluster_labels, openings
from common.planners.exploration.held_tour import HeldTour
from common.planners.exploration.nearest import NearestPlanner
from common.planners.exploration.sight_rows import SightRows, row_digests, rows_within, see_any
from common.planners.exploration.tour_problem import TourProblem
from common.planners.exploration.ways import Paths, place_keys
from common.planners.viewpoint_planner import ViewpointPlanner
from common.planners.visibility import unknown_in_sight

# Stops of the tour to which a plan shows the way.
STOPS_AHEAD: Final = 6
# Rays that measure the unknown area that a viewpoint may show.
RAYS: Final = 45

# Stands for a view and a gain that were never measured.
_NEVER: Final = (-1, 0.0)


class CoveringTourPlanner(ViewpointPlanner):
    """Cover all frontiers by viewpoints, take the shortest tour through these, and replan it at each viewpoint.

    It is no published planner: it is what the privileged expert of this project's training does on the true map, done
    on the belief. Covering tours over frontiers are at the root of TARE (Cao et al. 2021) and of FUEL (B. Zhou, Y.
    Zhang, X. Chen, S. Shen: "FUEL: Fast UAV Exploration Using Incremental Frontier Structure and Hierarchical
    Planning", IEEE Robotics and Automation Letters, 2021).

    - Frontier cells have to be seen from at most `cover_range`. What the mapper knows of lines of sight is used as it
      is (`Mapper.sightings`); nothing is looked at again.
    - A greedy set cover of the cells becomes an open tour: stops are inserted where they cost least, moved to where
      they cost less (from the middle of a room to its door), left out when others see the same, and reordered by 2-opt
      and Or-opt. One tour begins from what is left of the last decision's, which wins when it is not longer, and one
      anew.
    - Each neighbour of the robot's viewpoint is then priced: the way there and the tour that remains from there, the
      stops left out whose cells it sees itself. The robot goes to the cheapest one.
    - Remainders wait: clusters of fewer frontier cells than `min_frontier`, and viewpoints that could show less than
      `min_gain` of unknown area. Most of them are slivers along walls and behind furniture that hold nothing or so
      little that an exploration is complete without them. They are taken along where they lie on the way, at most
      `detour` each; else in a large building one returns for them in the end. Then clusters of at least `min_door`
      cells come first, from viewpoints from where at least `min_hidden` of unknown area can be in sight: a door that
      was only seen at a slant is a few cells, and the room behind it must not wait for a tour of all slivers. What is
      left when nothing else is, is seen in one tour.
    - Where the floor opens into the unknown on many sides, as between the shelves of a warehouse, the robot drives to
      the nearest frontier instead (see `NearestPlanner`). A tour would look a few metres into each aisle and come back,
      again and again, for what is seen on the way through the next one. With more than `most_openings` on 100 m2 of
      known floor, decided at each viewpoint, routes are a fifth shorter in warehouses, and as long as before in offices
      and tunnels (docs/evaluation.md).
    - It ends: a viewpoint is a stop no more once the robot has scanned from there, and a robot that comes back to one
      without having seen anything new keeps its tour until it has (see `HeldTour`).
    """

    name = "tour"

    def __init__(
        self,
        config: MappingConfig,
        *,
        cover_range: float | None = None,
        min_frontier: int = 6,
        min_remainder: float = 0.5,
        min_gain: float = 4.0,
        min_hidden: float = 8.0,
        min_door: int = 3,
        detour: float = 2.0,
        most_openings: float = 3.0,
    ) -> None:
        """Set up.

        Args:
            config: the mapping that the planner will be given.
            cover_range: frontiers are covered from up to here, metres; 0.8 of the sensor range when not given. A
                frontier at the very end of the range would tell nothing new from there.
            min_frontier: a cluster of fewer frontier cells waits. It counts cells, not metres: what beams leave between
                them are a few cells at any resolution, and a door of 0.8 m, which is three cells of 0.25 m, is eight
                of 0.1 m.
            min_remainder: a cluster that is shorter than this is not even taken along, metres.
            min_gain: a viewpoint from where less unknown area can be in sight waits, square metres.
            min_hidden: of what waits, viewpoints from where so much unknown area can be in sight come before the
                others, square metres.
            min_door: they do so for clusters of so many frontier cells. Smaller ones are gaps in walls: much unknown
                area is in sight through these, too, but nobody can drive there.
            detour: metres that a stop for what waits may add to the tour.
            most_openings: with more openings on 100 m2 of known floor than this the nearest frontier is driven to.

        Raises:
            ConfigError: a setting is out of range.
        """
        cover_range = 0.8 * config.sensor_range if cover_range is None else cover_range
        if not cover_range > 0.0:
            raise ConfigError(f"planner 'tour': cover_range must be above 0 m, got {cover_range}")
        for setting, value in (
            ("min_frontier", min_frontier),
            ("min_remainder", min_remainder),
            ("min_gain", min_gain),
            ("min_hidden", min_hidden),
            ("min_door", min_door),
            ("detour", detour),
            ("most_openings", most_openings),
        ):
            if not value >= 0.0:
                raise ConfigError(f"planner 'tour': {setting} must be at least 0, got {value}")
        self._cover_range = min(cover_range, config.observable_range)
        self._min_frontier = min_frontier
        self._min_remainder = min_remainder / config.resolution
        self._min_gain = min_gain
        self._min_hidden = min_hidden
        self._min_door = min_door
        self._detour = detour
        self._most_openings = most_openings
        self._nearest = NearestPlanner(config)
        super().__init__(config)

    def reset(self, task: TaskName, target: Position | None, seed: int) -> None:
        """Begin an episode: forget everything; there is no chance in this planner."""
        super().reset(task, target, seed)
        self._nearest.reset(task, target, seed)
        self._held = HeldTour()
        self._paths = Paths()
        self._last: list[int] = []
        self._gains: dict[int, tuple[int, float]] = {}

    @property
    def deputies(self) -> tuple[NearestPlanner]:
        """Who decides where the floor opens on many sides."""
        return (self._nearest,)

    def choose(
        self, mapper: Mapper, pose: Pose, candidates: NDArray[np.int64], positions: NDArray[np.float64]
    ) -> list[int]:
        """Return the neighbour to go to and the next stops of the tour from there."""
        labels = cluster_labels(*mapper.frontier_cells)
        if openings(np.bincount(labels), mapper.belief.resolution, mapper.explored_area) > self._most_openings:
            # This ends as well: the number of openings changes with what is seen, and with nothing else.
            return self._nearest.choose(mapper, pose, candidates, positions)
        stops = self._held.stops(
            mapper, candidates, positions, lambda: self._plan(mapper, candidates, positions, labels)
        )
        return stops[:STOPS_AHEAD]

    def _plan(
        self,
        mapper: Mapper,
        candidates: NDArray[np.int64],
        positions: NDArray[np.float64],
        labels: NDArray[np.int64],
    ) -> list[int]:
        """Return the stops of a new tour: of the rewarding ones, or where none is left of whatever is."""
        frontiers = mapper.frontiers
        self._paths.update(positions, mapper.adjacency)
        sizes = np.bincount(labels)[labels]
        pointer, seen = mapper.sightings()
        near = rows_within(pointer, seen, positions, frontiers, self._cover_range)
        allowed = np.zeros(len(positions), dtype=np.bool_)
        allowed[candidates] = True
        large = sizes >= self._min_frontier
        extra = sizes >= self._min_remainder
        every = np.ones(len(frontiers), dtype=np.bool_)

        def stages() -> Iterator[tuple[SightRows, NDArray[np.bool_], NDArray[np.bool_]]]:
            yield near, self._rewarding(mapper, near, frontiers, large, allowed, self._min_gain), large
            doors = sizes >= self._min_door
            yield near, self._rewarding(mapper, near, frontiers, doors, allowed, self._min_hidden), doors
            yield near, allowed, every
            yield (pointer, seen), allowed, every

        for rows, viewpoints, wanted in stages():
            if see_any(rows, wanted)[viewpoints].any():
                tour = TourProblem(mapper, self._paths, rows, labels, viewpoints, wanted, allowed, wanted | extra)
                stops = tour.solve(self._last, self._detour)
                if stops:
                    self._last = place_keys(positions[stops]).tolist()
                    return stops
        return []

    def _rewarding(
        self,
        mapper: Mapper,
        rows: SightRows,
        frontiers: NDArray[np.float64],
        wanted: NDArray[np.bool_],
        allowed: NDArray[np.bool_],
        enough: float,
    ) -> NDArray[np.bool_]:
        """Return which of the allowed viewpoints see wanted cells and could show enough behind them, square metres.

        A viewpoint's gain is measured again when the frontier cells that it sees have changed.
        """
        nodes = np.flatnonzero(allowed & see_any(rows, wanted))
        positions = mapper.viewpoints[nodes]
        keys = place_keys(positions).tolist()
        views = row_digests(*rows, nodes, place_keys(frontiers)).tolist()
        known = self._gains
        new = [k for k, (key, view) in enumerate(zip(keys, views, strict=True)) if known.get(key, _NEVER)[0] != view]
        most = max(self._min_gain, self._min_hidden)
        measured = unknown_in_sight(mapper, positions[new], self.config.sensor_range, RAYS, most)
        for k, gain in zip(new, measured.tolist(), strict=True):
            known[keys[k]] = views[k], gain
        worth = np.zeros(len(allowed), dtype=np.bool_)
        worth[[node for node, key in zip(nodes.tolist(), keys, strict=True) if known[key][1] >= enough]] = True
        return worth
