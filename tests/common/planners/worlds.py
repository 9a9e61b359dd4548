"""Small worlds with known answers, and the mapping that suits them."""

from __future__ import annotations

from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from common.config import MappingConfig, SimulatorConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from tests.common.planners.rollout import drawn

CONFIG = MappingConfig(resolution=0.5, sensor_range=10.0, viewpoint_spacing=4.0, beacon_range=10.0)

ROOM = drawn(["####", "#..#", "#S.#", "####"])
# A dead end whose one way out is long and turns.
DEAD_END = drawn(["########", "#S####.#", "#.####.#", "#......#", "########"])
# A corridor with a near arm to the left and a far one to the right.
ARMS = drawn(["#############", "#.####.######", "#....S......#", "#.####.####.#", "###########.#", "#############"])
ROOMS = drawn(
    [
        "############",
        "#....#.....#",
        "#....#.....#",
        "#..........#",
        "#....#.....#",
        "##.#####.###",
        "#....#.....#",
        "#.S..#.....#",
        "#..........#",
        "############",
    ]
)


def looked(
    world: GridMap, places: list[tuple[float, float]] | None = None, config: MappingConfig = CONFIG
) -> tuple[Mapper, Pose]:
    """Return a mapper that has scanned from the start, or from each of the places in turn, and the last pose."""
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=720), config.sensor_range)
    pose = simulator.reset(world, 0)
    mapper = Mapper(config, lattice_origin=world.lattice_origin)
    for place in places or [world.start]:
        pose = Pose(*place)
        simulator.place(pose)
        mapper.integrate(simulator.scan(), pose)
        mapper.update(pose)
    return mapper, pose
