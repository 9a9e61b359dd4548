"""Observations as the network reads them: node features, neighbour rows and ragged sets of choices, in numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.config import NetworkConfig
from common.network.reduction import kept_rows, renumbered
from common.observations.belief_raster import belief_raster
from common.observations.feature_sets import (
    DISTANCE_SCALE,
    FEATURE_NAMES,
    FeatureSet,
    computed_set,
    feature_columns,
    feature_count,
)
from common.observations.features import node_features
from common.observations.index import EXTRA_SLOTS, LINK_SLOT, NeighbourTable, neighbour_table
from common.observations.observation import ObservationBatch
from common.observations.overview import CLOSENESS, PAIR_FEATURES, Overview
from common.observations.paths import paths_toward, robot_paths
from common.system.jit import njit

_TARGET = FEATURE_NAMES["paper"].index("target")
_BEACON = FEATURE_NAMES["paper"].index("beacon")
_ON_PATH = FEATURE_NAMES["extended"].index("on_beacon_path")


@dataclass(frozen=True, slots=True, eq=False)
class GraphArrays:
    """k observations as packed nodes; rows count the nodes of all observations, targets included.

    A network on the reduced graph reads only some nodes (see `common.network.reduction`): rows count these, `nodes`
    tells which they are, and choices are still told by the node numbers of the observation.

    Networks that choose no beacon, `vanilla` and the baselines, have one dummy slot per observation as their beacon
    set, whose row is the robot's, so that every table and loss keeps one form.

    Attributes:
        features: float32, shape (nodes, F), see `common.observations.features`.
        neighbours: rows that a node attends to, -1 where absent, int32, shape (nodes, W + 2): its neighbours, itself,
            and the target where it is linked, as `common.observations.index.NeighbourTable` lays them out.
        node_ptr: first row of each observation, then the number of rows, int64, shape (k + 1,).
        robot_rows: row of the robot's node, int64, shape (k,).
        beacon_rows: rows of all beacons, ascending, int64, shape (total beacons,); an index into it is a *beacon
            slot*.
        beacon_ptr: first beacon slot of each observation, then their number, int64, shape (k + 1,).
        waypoint_rows: rows of all waypoints in the order of `Observation.waypoint_nodes`, int64; an index into it
            is a *waypoint slot*.
        waypoint_ptr: first waypoint slot of each observation, then their number, int64, shape (k + 1,).
        pairs: (observation, beacon slot, waypoint slot) of every pair, the waypoint running fastest, int64,
            shape (total pairs, 3).
        pair_ptr: first pair of each observation, then their number, int64, shape (k + 1,).
        nodes: node number, within its observation, of each row, int64, shape (nodes,).
        has_beacons: False for networks that choose no beacon.
        toward: 1 for pairs whose waypoint begins a shortest path to the beacon, else 0, float32, shape (total pairs,);
            empty unless the network reads it.
        image: as in `ObservationBatch`; None unless the network reads it.
        token_rows: rows of robots, beacons and targets, ascending, int64, shape (total tokens,); empty, as the next two
            and `pair_features`, unless the network reads them.
        token_ptr: first token of each observation, then their number, int64, shape (k + 1,).
        closeness: see `common.observations.overview.Overview.closeness`.
        raster: see `common.observations.belief_raster`, float32; empty, as `cells`, unless the network reads it.
        cells: cell of each node in it, int64, shape (nodes,).
        pair_features: of each pair, float32, shape (total pairs, features), see `Overview.pairs` there.
    """

    features: NDArray[np.float32]
    neighbours: NDArray[np.int32]
    node_ptr: NDArray[np.int64]
    robot_rows: NDArray[np.int64]
    beacon_rows: NDArray[np.int64]
    beacon_ptr: NDArray[np.int64]
    waypoint_rows: NDArray[np.int64]
    waypoint_ptr: NDArray[np.int64]
    pairs: NDArray[np.int64]
    pair_ptr: NDArray[np.int64]
    nodes: NDArray[np.int64]
    has_beacons: bool
    toward: NDArray[np.float32]
    image: NDArray[np.uint8] | None
    token_rows: NDArray[np.int64]
    token_ptr: NDArray[np.int64]
    closeness: NDArray[np.float32]
    pair_features: NDArray[np.float32]
    raster: NDArray[np.float32]
    cells: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.robot_rows)

    @classmethod
    def from_observations(cls, batch: ObservationBatch, config: NetworkConfig) -> GraphArrays:
        """Build the arrays of a batch for a network of ``config``.

        Raises:
            ValueError: the network reads images, and the observations have none.
        """
        if config.reads_image and batch.image is None:
            raise ValueError(
                f"this network reads images, and these observations have none: observe with "
                f"`mapper.observe(image={config.image_scale!r})`"
            )
        table = neighbour_table(batch)
        neighbours, node_ptr = table.rows, table.node_ptr
        robot_rows = node_ptr[:-1] + batch.robot
        nodes = np.arange(len(neighbours)) - np.repeat(node_ptr[:-1], np.diff(node_ptr))
        whole = config.graph == "full"
        read = computed_set(config.features) if whole else _choosing(config)
        paths = robot_paths(batch, table) if config.toward or read != "paper" else None
        features = node_features(batch, table, read, paths)
        toward = None
        if config.toward and paths is not None:
            on_path = features[:, _ON_PATH] > 0.0 if read != "paper" else np.ones(len(features), dtype=np.bool_)
            toward = paths_toward(batch, table, paths, on_path)
        overview = _overview(batch, table, features, robot_rows) if config.reads_overview else None
        raster, cells = np.zeros((0, 0), dtype=np.float32), np.zeros(0, dtype=np.int64)
        if config.belief_map and batch.image is not None:
            raster, cells = belief_raster(batch.image, features, node_ptr)
        first = np.arange(len(nodes))
        if not whole:
            kept = kept_rows(features, neighbours, robot_rows, node_ptr, tokens=config.graph == "tokens")
            place = np.where(kept, np.cumsum(kept) - 1, -1)
            neighbours = renumbered(neighbours, kept, place)
            features, first = features[kept], first[kept]
            cells = cells[kept] if config.belief_map else cells
            node_ptr = np.append(0, np.cumsum(kept))[node_ptr]
            nodes, robot_rows = nodes[kept], place[robot_rows]
            toward = toward[kept] if toward is not None else None
        if config.hierarchical:
            beacon_rows = np.flatnonzero(features[:, _BEACON] > 0.0)
            beacon_ptr = np.searchsorted(beacon_rows, node_ptr)
        else:
            beacon_rows, beacon_ptr = robot_rows.copy(), np.arange(len(batch) + 1)
        waypoint_rows, waypoint_ptr = _waypoint_sets(neighbours, robot_rows, batch.has_target & batch.target_known)
        pairs, pair_ptr = _pair_table(beacon_ptr, waypoint_ptr)
        begins = np.zeros(len(pairs) if toward is not None else 0, dtype=np.float32)
        if toward is not None:
            slots = np.arange(len(waypoint_rows)) - np.repeat(waypoint_ptr[:-1], np.diff(waypoint_ptr))
            slots[features[waypoint_rows, _TARGET] > 0.0] = neighbours.shape[1] - 1
            bits = toward[beacon_rows[pairs[:, 1]]] >> (slots[pairs[:, 2]] % 64).astype(np.uint64)
            begins[:] = bits & np.uint64(1)
        token_rows, token_ptr = np.zeros(0, dtype=np.int64), np.zeros(len(batch) + 1, dtype=np.int64)
        closeness, pair_features = np.zeros((0, CLOSENESS), np.float32), np.zeros((0, PAIR_FEATURES), np.float32)
        if overview is not None and config.beacon_attention:
            token_rows, token_ptr = np.searchsorted(first, overview.rows), overview.ptr
            closeness = overview.closeness(table.node_ptr, batch.reach)
        if overview is not None and config.detours:
            measured = np.stack([pairs[:, 0], first[beacon_rows[pairs[:, 1]]], first[waypoint_rows[pairs[:, 2]]]], 1)
            pair_features = overview.pairs(table.node_ptr, first[robot_rows], batch.reach, measured)
        if features.shape[1] != feature_count(config.features):
            features = np.ascontiguousarray(features[:, feature_columns(config.features)])
        return cls(
            features=features,
            neighbours=neighbours,
            node_ptr=node_ptr,
            robot_rows=robot_rows,
            beacon_rows=beacon_rows,
            beacon_ptr=beacon_ptr,
            waypoint_rows=waypoint_rows,
            waypoint_ptr=waypoint_ptr,
            pairs=pairs,
            pair_ptr=pair_ptr,
            nodes=nodes,
            has_beacons=config.hierarchical,
            toward=begins,
            image=batch.image if config.variant == "cnn" else None,
            token_rows=token_rows,
            token_ptr=token_ptr,
            closeness=closeness,
            pair_features=pair_features,
            raster=raster,
            cells=cells,
        )

    @property
    def waypoint_steps(self) -> NDArray[np.float32]:
        """Offset of each waypoint slot from the robot in lattice steps, float32, shape (total waypoints, 2)."""
        steps: NDArray[np.float32] = self.features[self.waypoint_rows, :2] * np.float32(DISTANCE_SCALE)
        return steps

    def beacon_slots(self, nodes: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the slot of one beacon node per observation, shape (k,); -1 stays -1.

        Where no beacon is chosen, every node gets the dummy slot.

        Raises:
            ValueError: a node is no beacon of its observation.
        """
        if not self.has_beacons:
            return np.where(nodes < 0, -1, np.arange(len(self)))
        return self._slots(nodes, self.beacon_rows, self.beacon_ptr, "beacon")

    def waypoint_slots(self, nodes: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the slot of one waypoint node per observation, shape (k,); -1 stays -1.

        Raises:
            ValueError: a node is no waypoint of its observation.
        """
        return self._slots(nodes, self.waypoint_rows, self.waypoint_ptr, "waypoint")

    def pair_index(self, beacons: NDArray[np.int32], waypoints: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the index into `pairs` of one (beacon node, waypoint node) per observation, shape (k,).

        Raises:
            ValueError: a node is no beacon or no waypoint of its observation.
        """
        beacon = self.beacon_slots(beacons) - self.beacon_ptr[:-1]
        waypoint = self.waypoint_slots(waypoints) - self.waypoint_ptr[:-1]
        if min(beacon.min(initial=0), waypoint.min(initial=0)) < 0:
            raise ValueError("every transition needs a chosen beacon and waypoint, but one of them is -1")
        return self.pair_ptr[:-1] + beacon * np.diff(self.waypoint_ptr) + waypoint

    def _slots(
        self, nodes: NDArray[np.int32], rows: NDArray[np.int64], ptr: NDArray[np.int64], what: str
    ) -> NDArray[np.int64]:
        slots = _find_slots(np.asarray(nodes, dtype=np.int64), self.nodes, rows, ptr)
        if len(slots) and slots.min() < -1:
            bad = int(np.argmin(slots))
            valid = self.nodes[rows[ptr[bad] : ptr[bad + 1]]].tolist()
            raise ValueError(
                f"observation {bad} of the batch: node {int(nodes[bad])} is no {what} of it; the {what}s are {valid}"
            )
        return slots


def _choosing(config: NetworkConfig) -> FeatureSet:
    """Return the features by which the nodes of a reduced graph are chosen, on the whole one."""
    return "guided" if config.features == "guided" else "extended"


def _overview(
    batch: ObservationBatch, table: NeighbourTable, features: NDArray[np.float32], robot_rows: NDArray[np.int64]
) -> Overview:
    """Measure the paths between robot, beacons and target on the whole graph."""
    tokens = (features[:, _BEACON] > 0.0) | (features[:, _TARGET] > 0.0)
    tokens[robot_rows] = True
    return Overview.of(batch, table, tokens)


@njit(cache=True, nogil=True)
def _waypoint_sets(
    neighbours: NDArray[np.int32], robot_rows: NDArray[np.int64], target_known: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    width = neighbours.shape[1] - EXTRA_SLOTS
    rows = np.empty(len(robot_rows) * (width + 1), dtype=np.int64)
    ptr = np.zeros(len(robot_rows) + 1, dtype=np.int64)
    at = 0
    for g in range(len(robot_rows)):
        for slot in range(width):
            other = neighbours[robot_rows[g], slot]
            if other >= 0:
                rows[at] = other
                at += 1
        target = neighbours[robot_rows[g], LINK_SLOT]
        if target_known[g] and target >= 0:
            rows[at] = target
            at += 1
        ptr[g + 1] = at
    return rows[:at], ptr


@njit(cache=True, nogil=True)
def _pair_table(
    beacon_ptr: NDArray[np.int64], waypoint_ptr: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    ptr = np.zeros(len(beacon_ptr), dtype=np.int64)
    for g in range(len(beacon_ptr) - 1):
        ptr[g + 1] = ptr[g] + (beacon_ptr[g + 1] - beacon_ptr[g]) * (waypoint_ptr[g + 1] - waypoint_ptr[g])
    pairs = np.empty((ptr[-1], 3), dtype=np.int64)
    at = 0
    for g in range(len(beacon_ptr) - 1):
        for beacon in range(beacon_ptr[g], beacon_ptr[g + 1]):
            for waypoint in range(waypoint_ptr[g], waypoint_ptr[g + 1]):
                pairs[at, 0] = g
                pairs[at, 1] = beacon
                pairs[at, 2] = waypoint
                at += 1
    return pairs, ptr


@njit(cache=True, nogil=True)
def _find_slots(
    nodes: NDArray[np.int64], of_rows: NDArray[np.int64], rows: NDArray[np.int64], ptr: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find one node per observation; -1 for node -1, -2 where it is not in the set."""
    slots = np.full(len(nodes), -2, dtype=np.int64)
    for g in range(len(nodes)):
        if nodes[g] == -1:
            slots[g] = -1
        for slot in range(ptr[g], ptr[g + 1]):
            if of_rows[rows[slot]] == nodes[g]:
                slots[g] = slot
    return slots
