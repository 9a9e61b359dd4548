"""`GraphArrays` as torch tensors: the input of the networks."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.config import NetworkConfig
from common.network.graph_arrays import GraphArrays
from common.network.padding import Padding
from common.observations.observation import ObservationBatch


@dataclass(frozen=True, slots=True, eq=False)
class GraphBatch:
    """k observations as tensors on one device.

    Attributes:
        arrays: the same on the host, with the meaning of every field and the helpers that find slots.
        features: float32, shape (nodes, F).
        neighbours: int32, shape (nodes, W + 2), -1 where absent.
        node_ptr: int64, shape (k + 1,).
        node_graph: observation of each node, int64, shape (nodes,).
        robot_rows: int64, shape (k,).
        beacon_rows: int64, shape (total beacons,).
        beacon_ptr: int64, shape (k + 1,).
        beacon_graph: observation of each beacon slot, int64, shape (total beacons,).
        waypoint_rows: int64, shape (total waypoints,).
        waypoint_ptr: int64, shape (k + 1,).
        waypoint_graph: observation of each waypoint slot, int64, shape (total waypoints,).
        pair_graph: observation of each pair, int64, shape (total pairs,).
        pair_beacon: beacon slot of each pair, int64, shape (total pairs,).
        pair_waypoint: waypoint slot of each pair, int64, shape (total pairs,).
        toward: as in `GraphArrays`.
        image: as in `GraphArrays`, or None.
        token_rows: int64, shape (total tokens,).
        closeness: as in `GraphArrays`.
        pair_features: as in `GraphArrays`.
        raster: as in `GraphArrays`.
        cells: as in `GraphArrays`.
        padding: the nodes in blocks, on devices other than the CPU; None there.
    """

    arrays: GraphArrays
    features: Tensor
    neighbours: Tensor
    node_ptr: Tensor
    node_graph: Tensor
    robot_rows: Tensor
    beacon_rows: Tensor
    beacon_ptr: Tensor
    beacon_graph: Tensor
    waypoint_rows: Tensor
    waypoint_ptr: Tensor
    waypoint_graph: Tensor
    pair_graph: Tensor
    pair_beacon: Tensor
    pair_waypoint: Tensor
    toward: Tensor
    image: Tensor | None
    token_rows: Tensor
    closeness: Tensor
    pair_features: Tensor
    raster: Tensor
    cells: Tensor
    padding: Padding | None = None

    def __len__(self) -> int:
        return len(self.robot_rows)

    @classmethod
    def from_observations(cls, batch: ObservationBatch, config: NetworkConfig) -> GraphBatch:
        """Build the tensors of a batch, on the CPU, for a network of ``config``."""
        return cls.from_arrays(GraphArrays.from_observations(batch, config))

    @classmethod
    def from_arrays(cls, arrays: GraphArrays) -> GraphBatch:
        """Wrap arrays as tensors on the CPU."""
        pairs = np.ascontiguousarray(arrays.pairs.T)
        return cls(
            arrays=arrays,
            features=torch.from_numpy(arrays.features),
            neighbours=torch.from_numpy(arrays.neighbours),
            node_ptr=torch.from_numpy(arrays.node_ptr),
            node_graph=_owner(arrays.node_ptr),
            robot_rows=torch.from_numpy(arrays.robot_rows),
            beacon_rows=torch.from_numpy(arrays.beacon_rows),
            beacon_ptr=torch.from_numpy(arrays.beacon_ptr),
            beacon_graph=_owner(arrays.beacon_ptr),
            waypoint_rows=torch.from_numpy(arrays.waypoint_rows),
            waypoint_ptr=torch.from_numpy(arrays.waypoint_ptr),
            waypoint_graph=_owner(arrays.waypoint_ptr),
            pair_graph=torch.from_numpy(pairs[0]),
            pair_beacon=torch.from_numpy(pairs[1]),
            pair_waypoint=torch.from_numpy(pairs[2]),
            toward=torch.from_numpy(arrays.toward),
            image=None if arrays.image is None else torch.from_numpy(arrays.image),
            token_rows=torch.from_numpy(arrays.token_rows),
            closeness=torch.from_numpy(arrays.closeness),
            pair_features=torch.from_numpy(arrays.pair_features),
            raster=torch.from_numpy(arrays.raster),
            cells=torch.from_numpy(arrays.cells),
        )

    def to(self, device: torch.device | str) -> GraphBatch:
        """Return the batch on a device; itself when it is there already."""
        if self.features.device == torch.device(device):
            return self
        held = {field.name: getattr(self, field.name) for field in fields(self)}
        del held["arrays"], held["padding"]
        moved: dict[str, Any] = {
            name: value if value is None else value.to(device, non_blocking=True) for name, value in held.items()
        }
        on_cpu = torch.device(device).type == "cpu"
        padding = None if on_cpu else Padding.of(self.arrays.node_ptr, moved["neighbours"])
        return GraphBatch(arrays=self.arrays, padding=padding, **moved)


def _owner(ptr: NDArray[np.int64]) -> Tensor:
    """Return the observation to which each item of a ragged set belongs."""
    return torch.from_numpy(np.repeat(np.arange(len(ptr) - 1), np.diff(ptr)))
