"""Measure the mapper in a large building that is wholly explored: milliseconds of a core an update, and its memory.

`python -m benchmarks.large_plan [PLAN]` knows a floor plan of 265 m x 88 m at cells of 0.1 m from the start, drives a
robot of radius 0.25 m through it with scans, and prints median and 95th percentile of a step (integrate, update and
observe) and the most memory that the mapper takes, for viewpoints 4 m and 2 m apart. The plan is one of the public
ones, which lie beside the repository; without them there is nothing to measure, and it says so.
"""

from __future__ import annotations

import argparse
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np

from actors.maps.grid_map import GridMap
from actors.maps.image_map import load_image
from common.config import MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.mapping.raycast import cast_rays, ray_angles
from common.mapping.warmup import warm_up

PLAN = Path("../shared/data/maps/floorplans/50015847_0.png")
RESOLUTION = 0.1
RADIUS = 0.25
SPACINGS = (4.0, 2.0)
BEAMS = 720
STEPS = 300
MEMORY_STEPS = 30


def explored(world: GridMap, spacing: float) -> Mapper:
    """Return a mapper that knows a whole world, updated at its start."""
    config = MappingConfig(resolution=world.resolution, viewpoint_spacing=spacing, robot_radius=RADIUS)
    width, height = world.size
    x, y = world.origin
    mapper = Mapper(config, lattice_origin=world.lattice_origin, bounds=(x, y, x + width, y + height))
    mapper.belief.assign(np.where(world.free, 0, 100).astype(np.int8), world.origin)
    mapper.update(Pose(*world.start))
    return mapper


def most_held(world: GridMap, spacing: float, steps: int) -> float:
    """Return the most megabytes that making a mapper of the whole world and some steps with it allocate at a time."""
    tracemalloc.start()
    drive(explored(world, spacing), world, steps)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most / 1e6


def drive(mapper: Mapper, world: GridMap, steps: int) -> list[float]:
    """Go from viewpoint to viewpoint towards places all over the building; return CPU seconds of each step."""
    rng = np.random.default_rng(0)
    angles = ray_angles(0.0, 0.0, 2 * np.pi / BEAMS, BEAMS)
    reach = mapper.belief.sensor_range
    path: list[int] = []
    times: list[float] = []
    while len(times) < steps:
        if not path:
            path = mapper.path(mapper.robot, int(rng.integers(len(mapper.viewpoints))))[1:]
            continue
        # A wholly known world keeps its viewpoints, and so their numbers.
        pose = Pose(*mapper.position(path.pop(0)))
        ranges = cast_rays(world.free, world.resolution, *world.origin, pose.x, pose.y, angles, reach)
        scan = Scan(ranges, 0.0, 2 * np.pi / BEAMS, reach)
        start = process_time()
        mapper.integrate(scan, pose)
        mapper.update(pose)
        mapper.observe()
        times.append(process_time() - start)
    return times


def run(plan: Path = PLAN, steps: int = STEPS, log: Callable[[str], None] = print) -> dict[str, float]:
    """Measure; return figures by name, milliseconds and megabytes, none where the plan is not at hand."""
    if not plan.is_file():
        log(f"skipped: {plan} is not there; it is one of the public floor plans, which are not part of the repository")
        return {}
    warm_up()
    world = load_image(plan, RESOLUTION)
    figures: dict[str, float] = {}
    for spacing in SPACINGS:
        mapper = explored(world, spacing)
        times = np.array(drive(mapper, world, steps)) * 1e3
        megabytes = most_held(world, spacing, min(steps, MEMORY_STEPS))
        median, p95 = float(np.median(times)), float(np.percentile(times, 95))
        log(
            f"{plan.stem}, {RESOLUTION:g} m cells, viewpoints {spacing:g} m apart: {len(mapper.viewpoints)} of them, "
            f"step median {median:.2f} ms, p95 {p95:.2f} ms, at most {megabytes:.0f} MB"
        )
        prefix = f"large_plan.{spacing:g}m"
        figures |= {f"{prefix}.step_ms": median, f"{prefix}.step_p95_ms": p95, f"{prefix}.memory_mb": megabytes}
    return figures


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", nargs="?", type=Path, default=PLAN, help="a floor plan (default: %(default)s)")
    run(parser.parse_args().plan)


if __name__ == "__main__":
    main()
