"""Measure a decision step of the mapping: scan already made, then integrate, update and observe.

`python -m benchmarks.decision_step [SOURCE]` walks a robot through worlds of a source (a folder of PNG maps or
`generator:NAME`) until nothing useful is left, and prints the median of each stage in milliseconds. Without an
argument it takes the public benchmark maps where they are at hand, else generated rooms.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

from actors.maps.grid_map import GridMap
from actors.maps.sources import open_sources
from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.raycast import cast_rays, ray_angles
from common.mapping.warmup import warm_up
from common.observations.observation import Observation

PUBLIC_MAPS = Path("../shared/data/maps/exploration/bench")
BEAMS = 720
MAX_STEPS = 128
STAGES = ("cast", "integrate", "update", "observe")


def default_source() -> str:
    """Return the public benchmark maps, or the generator that resembles them."""
    return str(PUBLIC_MAPS) if PUBLIC_MAPS.is_dir() else "generator:rooms"


def walk(world: GridMap, resolution: float) -> list[tuple[float, ...]]:
    """Explore one world and return the seconds of each stage (`STAGES`) for every decision.

    The robot then drives to the nearest useful viewpoint where it has not been, and keeps to it until it is useful no
    more or reached.
    """
    config = MappingConfig(resolution=resolution)
    width, height = world.size
    bounds = (*world.origin, world.origin[0] + width, world.origin[1] + height)
    mapper = Mapper(config, lattice_origin=world.lattice_origin, bounds=bounds)
    angles = ray_angles(0.0, 0.0, 2 * np.pi / BEAMS, BEAMS)
    pose = Pose(*world.start)
    goal: tuple[float, float] | None = None
    times = []
    for _ in range(MAX_STEPS):
        clock = [perf_counter()]
        ranges = cast_rays(world.free, world.resolution, *world.origin, pose.x, pose.y, angles, config.sensor_range)
        clock.append(perf_counter())
        mapper.integrate(Scan(ranges, 0.0, 2 * np.pi / BEAMS, config.sensor_range), pose)
        clock.append(perf_counter())
        mapper.update(pose)
        clock.append(perf_counter())
        observation = mapper.observe()
        clock.append(perf_counter())
        times.append(tuple(np.diff(clock).tolist()))
        goal = _goal(mapper, observation, goal)
        if goal is None:
            break
        node = int(np.argmin(np.hypot(*(mapper.viewpoints - goal).T)))
        pose = Pose(*mapper.position(mapper.path(observation.robot, node)[1]))
    return times


def _goal(mapper: Mapper, observation: Observation, goal: tuple[float, float] | None) -> tuple[float, float] | None:
    useful = np.flatnonzero((observation.utility > 0) & ~observation.visited)
    if len(useful) == 0:
        return None
    if goal is not None and any(mapper.position(int(node)) == goal for node in useful):
        return goal
    return mapper.position(int(useful[np.argmin(mapper.distances(observation.robot)[useful])]))


def measure(source: str, resolution: float, worlds: int, log: Callable[[str], None]) -> dict[str, float]:
    """Walk through worlds spread evenly over a source and return medians and the 95th percentile, milliseconds."""
    maps = open_sources([source], 0.25, "exploration")
    count = min(worlds, len(maps))
    stride = len(maps) // count if len(maps) < 10_000 else 1
    times = np.array([row for k in range(count) for row in walk(maps.world(k * stride), resolution)]) * 1e3
    steps = times[:, 1:].sum(axis=1)
    median, mean = np.median(times, axis=0), times.mean(axis=0)
    log(f"{source}, {resolution:g} m cells: {count} worlds, {len(times)} decisions, milliseconds")
    log(f"  {'stage':12}{'median':>9}{'mean':>9}{'p95':>9}")
    for k, stage in enumerate(STAGES):
        log(f"  {stage:12}{median[k]:9.3f}{mean[k]:9.3f}{np.percentile(times[:, k], 95):9.3f}")
    log(f"  {'decision':12}{np.median(steps):9.3f}{steps.mean():9.3f}{np.percentile(steps, 95):9.3f}")
    prefix = f"decision_step.{resolution:g}m"
    figures = {f"{prefix}.{stage}_ms": float(median[k]) for k, stage in enumerate(STAGES)}
    figures[f"{prefix}.decision_ms"] = float(np.median(steps))
    figures[f"{prefix}.decision_p95_ms"] = float(np.percentile(steps, 95))
    return figures


def run(
    source: str | None = None, worlds: int = 30, resolutions: Sequence[float] = (0.25, 0.5, 0.1)
) -> dict[str, float]:
    """Measure with cells of several sides, metres; return figures by name, milliseconds."""
    warm_up()
    chosen = source or default_source()
    figures = {}
    for resolution in resolutions:
        figures.update(measure(chosen, resolution, worlds, print))
    return figures


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", nargs="?", help="folder of PNG maps or generator:NAME")
    parser.add_argument("--worlds", type=int, default=30, help="how many worlds (default: %(default)s)")
    arguments = parser.parse_args()
    run(arguments.source, arguments.worlds)


if __name__ == "__main__":
    main()
