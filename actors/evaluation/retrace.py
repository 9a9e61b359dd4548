"""Replays a recorded route: the belief as it was at each waypoint, for recounts, plots and videos."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from actors.evaluation.pixels import Position, to_metres
from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from actors.tasks.coverage import Coverage
from common.config import MappingConfig, SimulatorConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper


@dataclass(frozen=True, slots=True)
class Moment:
    """The robot at one waypoint, after its scan.

    Attributes:
        number: of the waypoint, 0 for the start.
        pose: where the robot stands.
        mapper: what it knows; changes along the route.
        coverage: what it has seen of the true map; changes likewise.
        distance: travelled metres.
        known: the way here was known to be free before it was driven.
        clear: the way here is free on the true map.
    """

    number: int
    pose: Pose
    mapper: Mapper
    coverage: Coverage
    distance: float
    known: bool
    clear: bool


def retrace(
    world: GridMap,
    waypoints: Sequence[Position],
    mapping: MappingConfig,
    simulator: SimulatorConfig,
    *,
    seed: int = 0,
    navigation: bool = False,
) -> Iterator[Moment]:
    """Drive a recorded route again; see `follow`, but for its waypoints: pixels of the image, the start first."""
    positions = [to_metres(world, waypoint) for waypoint in waypoints]
    return follow(world, positions, mapping, simulator, seed=seed, navigation=navigation)


def follow(
    world: GridMap,
    positions: Iterable[Position],
    mapping: MappingConfig,
    simulator: SimulatorConfig,
    *,
    seed: int = 0,
    navigation: bool = False,
) -> Iterator[Moment]:
    """Drive a route in the grid simulator, scanning at its positions as the nominal protocol does.

    The route is driven as it is given, even where that breaks a rule; each moment says whether it did.

    Args:
        world: the true map.
        positions: (x, y) in metres, the start first; each is asked for when the moment before it has been told.
        mapping: what is made of the scans.
        simulator: beams and noise of the sensor.
        seed: of the noise.
        navigation: give the world's target to the mapper.
    """
    robot = GridSimulator(simulator.model_copy(update={"name": "grid"}), mapping.sensor_range)
    pose = robot.reset(world, seed)
    width, height = world.size
    bounds = (*world.origin, world.origin[0] + width, world.origin[1] + height)
    mapper = Mapper(
        mapping,
        lattice_origin=world.lattice_origin,
        bounds=bounds,
        target=world.target if navigation else None,
    )
    coverage = Coverage(world, mapping.robot_radius)
    distance = 0.0
    for number, position in enumerate(positions):
        known = clear = True
        if number:
            known = mapper.segment_free(pose.position, position)
            length = pose.distance_to(position)
            leg = robot.drive_to(position)
            clear = leg.reached
            for seen_from, scan in leg.sensed:
                mapper.integrate(scan, seen_from)
            pose = Pose(*position, leg.pose.yaw)
            distance += length
        elif pose.distance_to(position) > 0.0:
            pose = Pose(*position, pose.yaw)
        if world.is_free(position):
            robot.place(pose)
            mapper.integrate(robot.scan(), pose)
            mapper.update(pose)
            coverage.update(mapper.belief.cells, mapper.belief.resolution, mapper.belief.origin)
        else:
            clear = False
        yield Moment(number, pose, mapper, coverage, distance, known, clear)
