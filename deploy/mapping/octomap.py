"""OctoMap by option: clouds into an octree, a band of heights projected to the plane (Hornung et al., 2013)."""

from __future__ import annotations

from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.mapping.sight import FREE, OCCUPIED, UNKNOWN
from common.system.extras import optional
from deploy.config import SensingConfig
from deploy.mapping.measured_grid import MeasuredGrid
from deploy.mapping.waiting import Cloud

# What `OcTree.getLabels` calls the states of a voxel.
_LABELS = {1: OCCUPIED, 0: FREE}


class OctoMap:
    """A 3D map of a robot's clouds.

    A column of voxels is occupied when any voxel in the band of heights is, else free when any is, else unknown, as
    octomap_server projects its map.

    Attributes:
        columns: the projection, one cell per column; its numbering begins at the map frame's origin.
    """

    def __init__(self, config: SensingConfig, range_max: float) -> None:
        """Begin an empty tree.

        Raises:
            MissingPackageError: pyoctomap is not installed.
        """
        with optional("sensing.octomap", "octomap", instead="set sensing.octomap to false"):
            import pyoctomap

        self.columns = MeasuredGrid(config.octomap_resolution, (0.0, 0.0))
        self._config = config
        self._range_max = range_max
        self._tree: Any = pyoctomap.OcTree(config.octomap_resolution)
        self._tree.setProbHit(config.probability_hit)
        self._tree.setProbMiss(config.probability_miss)
        low, high = config.probability_limits
        self._tree.setClampingThresMin(low)
        self._tree.setClampingThresMax(high)

    def insert(self, cloud: Cloud) -> None:
        """Add a cloud and bring the columns that it can have changed up to date."""
        points = cloud.transform.apply(cloud.points[:, :3].astype(np.float64))
        away = points - np.array(cloud.sensor)
        distance = np.sqrt((away**2).sum(axis=1))
        told = (distance >= self._config.range_min) & np.isfinite(distance)
        # A return just before a voxel's border is one of the voxel behind it, as for the log-odds.
        points = points[told] + away[told] * (self._config.range_noise / distance[told])[:, None]
        if len(points) == 0:
            return
        self._tree.insertPointCloud(
            points, np.array(cloud.sensor), max_range=self._range_max, lazy_eval=True, discretize=True
        )
        self._tree.updateInnerOccupancy()
        voxel = self._config.octomap_resolution
        reach = np.array(cloud.sensor[:2])
        low = np.maximum(np.minimum(points[:, :2].min(axis=0), reach), reach - self._range_max)
        high = np.minimum(np.maximum(points[:, :2].max(axis=0), reach), reach + self._range_max)
        left, bottom = (floor(value / voxel) for value in low)
        right, top = (floor(value / voxel) + 1 for value in high)
        lowest = ceil((cloud.floor + self._config.height_min) / voxel - 0.5)
        highest = max(floor((cloud.floor + self._config.height_max) / voxel - 0.5), lowest)
        self.columns.write(self._project(left, right, bottom, top, lowest, highest), bottom, left)

    def _project(self, left: int, right: int, bottom: int, top: int, lowest: int, highest: int) -> NDArray[np.int8]:
        voxel = self._config.octomap_resolution
        rows, columns = np.meshgrid(np.arange(bottom, top), np.arange(left, right), indexing="ij")
        out = np.full(rows.shape, UNKNOWN, dtype=np.int8)
        centres = np.empty((rows.size, 3))
        centres[:, 0] = (columns.reshape(-1) + 0.5) * voxel
        centres[:, 1] = (rows.reshape(-1) + 0.5) * voxel
        for layer in range(lowest, highest + 1):
            centres[:, 2] = (layer + 0.5) * voxel
            labels = np.asarray(self._tree.getLabels(centres)).reshape(rows.shape)
            for label, state in _LABELS.items():
                found = labels == label
                out[found] = np.maximum(out[found], np.int8(state))
        return out
