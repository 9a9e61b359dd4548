"""What each simulator costs: ``python -m benchmarks.simulators [SOURCE]``.

Reset, one scan of 720 beams and a leg of 4 m from stand to stand, for each simulator and fidelity, in milliseconds.
Processor time, not wall time: each simulator is one thread and never waits. Each figure is the least of several repeats
on each of three worlds, averaged over the worlds: the least, because a busy machine only ever makes a run slower.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import process_time

import numpy as np

from actors.maps.grid_map import GridMap
from actors.maps.sources import open_sources
from actors.simulators.dynamic import DynamicSimulator
from actors.simulators.factory import make_simulator
from actors.simulators.grid import GridSimulator
from actors.simulators.kinematic import KinematicSimulator
from common.config import SimulatorConfig
from common.errors import MapError
from common.geometry import Pose
from common.mapping.raycast import cast_rays

SENSOR_RANGE = 20.0
LEG = 4.0
WORLDS = 3
SETTINGS: dict[str, dict[str, str | int | float]] = {
    "grid": {"name": "grid"},
    "kinematic": {"fidelity": "kinematic"},
    "kinematic_16_layers": {"fidelity": "kinematic", "lidar_layers": 16},
    "dynamic": {"fidelity": "dynamic"},
    "dynamic_without_scans": {"fidelity": "dynamic", "lidar_rate": 1e-3},
    "dynamic_16_layers": {"fidelity": "dynamic", "lidar_layers": 16},
}


def run(source: str = "generator:rooms", repeats: int = 7, worlds: int = WORLDS) -> dict[str, float]:
    """Measure all simulators and return milliseconds (and physics steps per second) by name."""
    maps = open_sources([source], 0.25, "exploration")
    figures: dict[str, float] = {}
    for label, settings in SETTINGS.items():
        simulator = make_simulator(SimulatorConfig.model_validate(settings), SENSOR_RANGE)
        assert isinstance(simulator, GridSimulator | KinematicSimulator | DynamicSimulator)
        try:
            rows = [_measure(simulator, maps.world(index), repeats) for index in range(worlds)]
        finally:
            simulator.close()
        reset, scan, leg, duration = np.mean(rows, axis=0)
        figures |= {f"{label}_reset_ms": reset, f"{label}_scan_ms": scan, f"{label}_leg_ms": leg}
        if label == "dynamic_without_scans":
            figures["physics_steps_per_second"] = 240.0 * duration / (1e-3 * leg)
    return figures


def _measure(
    simulator: GridSimulator | KinematicSimulator | DynamicSimulator, world: GridMap, repeats: int
) -> tuple[float, float, float, float]:
    """Return least milliseconds of reset, scan and leg, and the simulated seconds of the leg."""
    pose, waypoint = _straight_leg(world)
    simulator.reset(world, seed=0)
    simulator.scan()
    reset = _least(lambda: simulator.reset(world, seed=0), repeats)
    simulator.place(pose)
    scan = _least(simulator.scan, 5 * repeats)
    leg, duration = np.inf, 0.0
    for _ in range(repeats):
        simulator.place(pose)
        began = process_time()
        result = simulator.drive_to(waypoint)
        leg = min(leg, 1e3 * (process_time() - began))
        assert result.reached
        duration = result.duration
    return reset, scan, leg, duration


def _least(action: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        began = process_time()
        action()
        times.append(process_time() - began)
    return 1e3 * min(times)


def _straight_leg(world: GridMap) -> tuple[Pose, tuple[float, float]]:
    """Find a free straight leg of 4 m near the middle of a world; the robot looks along it."""
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(world.free)
    for index in rng.permutation(len(rows)):
        x = world.origin[0] + (columns[index] + 0.5) * world.resolution
        y = world.origin[1] + (rows[index] + 0.5) * world.resolution
        angles = np.radians(np.arange(0.0, 360.0, 10.0))
        ranges = cast_rays(world.free, world.resolution, *world.origin, x, y, angles, 2.0 * LEG)
        if ranges.min() > 0.5 and ranges[0] > LEG + 1.0:
            return Pose(float(x), float(y)), (float(x + LEG), float(y))
    raise MapError(f"map {world.name!r} has no straight way of {LEG} m: measure on another source")


def main() -> None:
    """Measure and print one line per figure."""
    parser = argparse.ArgumentParser(description="Measure the simulators.")
    parser.add_argument("source", nargs="?", default="generator:rooms", help="folder of PNG maps or generator:NAME")
    for name, value in run(parser.parse_args().source).items():
        print(f"{name:36s} {value:12.3f}")


if __name__ == "__main__":
    main()
