"""Draws the pictures of docs/simulators.md: ``python -m actors.simulators.pictures docs/pictures``."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from actors.maps.generators import make_generator
from actors.maps.grid_map import GridMap
from actors.simulators.bullet import pybullet
from actors.simulators.dynamic import DynamicSimulator
from actors.simulators.view import render
from common.config import SimulatorConfig
from common.mapping.raycast import cast_rays

_RETURN_COLOUR, _WAY_COLOUR = (0.95, 0.35, 0.05, 1.0), (0.10, 0.45, 0.85, 1.0)
_SIZE = (960, 600)


def draw(folder: Path) -> None:
    """Render the robot, its lidar's returns and a driven way in generated worlds, as PNG files in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    config = SimulatorConfig(fidelity="dynamic", lidar_layers=16)
    simulator = DynamicSimulator(config, 20.0, visible=True)
    try:
        for generator, index, name in (("office", 3, "office"), ("forest", 1, "forest")):
            world = make_generator(generator, {}).world(index)
            pose = simulator.reset(world, seed=0)
            client = simulator.physics.client
            if name == "office":
                near = (pose.x, pose.y, 0.2)
                _save(render(client, near, distance=1.6, yaw=125.0, pitch=-20.0, size=_SIZE), folder, "robot")
            way = [pose.position]
            for _ in range(3):
                leg = simulator.drive_to(_far_place(world, simulator))
                way += [passed.position for passed, _ in leg.sensed]
            simulator.scan()
            _dots(client, ((x, y, 0.06) for x, y in way[::2]), 0.06, _WAY_COLOUR)
            cloud = simulator.point_cloud()
            _dots(client, map(tuple, cloud[cloud[:, 2] > 0.15][::7]), 0.05, _RETURN_COLOUR)
            pose = simulator.pose
            view = render(client, (pose.x, pose.y, 0.2), distance=15.0, yaw=25.0, pitch=-48.0, size=_SIZE)
            _save(view, folder, name)
    finally:
        simulator.close()


def _far_place(world: GridMap, simulator: DynamicSimulator) -> tuple[float, float]:
    """Return a place 60 % of the way to where the robot sees furthest to its left or ahead."""
    pose = simulator.pose
    angles = pose.yaw + np.radians(np.arange(-40.0, 141.0, 5.0))
    ranges = cast_rays(world.free, world.resolution, *world.origin, pose.x, pose.y, angles, 15.0)
    ranges[np.isinf(ranges)] = 15.0
    best = int(np.argmax(ranges))
    length = 0.6 * float(ranges[best])
    return pose.x + length * float(np.cos(angles[best])), pose.y + length * float(np.sin(angles[best]))


def _dots(
    client: int, points: Iterable[Sequence[float]], radius: float, colour: tuple[float, float, float, float]
) -> None:
    look = pybullet.createVisualShape(
        pybullet.GEOM_BOX, halfExtents=(radius, radius, radius), rgbaColor=colour, physicsClientId=client
    )
    for point in points:
        pybullet.createMultiBody(
            baseMass=0.0, baseVisualShapeIndex=look, basePosition=tuple(point), physicsClientId=client
        )


def _save(picture: NDArray[np.uint8], folder: Path, name: str) -> None:
    Image.fromarray(picture).quantize(128).save(folder / f"simulator-{name}.png", optimize=True)


def main() -> None:
    """Draw into the folder that the command line names."""
    parser = argparse.ArgumentParser(description="Draw the pictures of the simulators.")
    parser.add_argument("folder", type=Path, help="where the PNG files go")
    draw(parser.parse_args().folder)


if __name__ == "__main__":
    main()
