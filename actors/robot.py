"""One simulated robot: it drives ways, senses, and maps what it sees."""

from __future__ import annotations

import time
from collections.abc import Callable

from actors.maps.grid_map import GridMap
from actors.simulators.base import Leg, Simulator, Watch
from common.config import ImageScale, MappingConfig
from common.geometry import Pose, Scan
from common.mapping.mapper import Mapper
from common.observations.observation import Observation
from common.planners.base import Position
from common.planners.goals import nothing_to_see

# Nearer to its viewpoint than this, metres, the robot counts as standing on it.
ON_VIEWPOINT = 0.3


class Robot:
    """Drives in the simulator for one episode; knows of the world only what its sensors show.

    Usage::

        robot = Robot(simulator, mapping, world, seed=0)
        robot.update()
        reached = robot.drive(robot.mapper.way(robot.mapper.robot, waypoint), done=lambda: False)

    Attributes:
        mapper: what the robot knows.
        pose: where it stands.
        positions: (x, y) of the start and of the end of every leg, metres.
        corners: those of the positions, by number, at which nothing was decided: corners of ways that are not straight.
        distance: travelled metres.
        collisions: contacts with the world.
        mapping_seconds: processor time that the mapper took, seconds; whoever reads it sets it back.
    """

    def __init__(
        self,
        simulator: Simulator,
        mapping: MappingConfig,
        world: GridMap,
        seed: int,
        target: Position | None = None,
        *,
        images: ImageScale | None = None,
    ) -> None:
        """Put the robot on the start of a world and look around; call `update` before anything else.

        Args:
            simulator: the world and the robot.
            mapping: what the robot makes of its scans.
            world: where.
            seed: of the simulator.
            target: (x, y) of a navigation target, metres.
            images: draw the belief into each observation at this scale.
        """
        self._simulator = simulator
        self._spacing = mapping.viewpoint_spacing
        self._images = images
        self.collisions = 0
        self.distance = self.mapping_seconds = 0.0
        self.pose = simulator.reset(world, seed)
        self.positions = [self.pose.position]
        self.corners: list[int] = []
        width, height = world.size
        self.mapper = Mapper(
            mapping,
            lattice_origin=world.lattice_origin,
            bounds=(*world.origin, world.origin[0] + width, world.origin[1] + height),
            target=target,
        )
        self._look()

    def drive(self, way: list[Position], done: Callable[[], bool], watch: Watch | None = None) -> bool:
        """Drive along a way, sensing at its corners and its end; return whether the robot got there.

        Where its first leg is not known to be free from where the robot stands, it goes by way of its viewpoint. The
        graph is brought up to date where the robot stops: at corners nothing is decided.

        Args:
            way: corners and end, metres.
            done: asked after each scan; the robot stops there when it says so.
            watch: takes the scans on the way, see `watch`.
        """
        if not self.mapper.segment_free(self.pose.position, way[0]) and not self.mapper.stuck:
            home = self.mapper.way_home()
            if self.pose.distance_to(home[-1]) > 1e-6 and way[: len(home)] != home:
                way = [*home, *way]
        reached = True
        for place in way:
            if self.pose.distance_to(place) == 0.0 and place != way[-1]:
                continue
            leg = self._simulator.drive_to(place) if watch is None else self._simulator.drive_to(place, watch)
            reached = self._take(leg) or leg.stopped
            self._look()
            if done() or not reached or leg.stopped:
                break
            if place != way[-1]:
                self.corners.append(len(self.positions) - 1)
        self.update()
        return reached

    def go_to_viewpoint(self, done: Callable[[], bool]) -> None:
        """Drive to the robot's viewpoint when it stands beside it; ``done`` as in `drive`."""
        if self.pose.distance_to(self.mapper.position(self.mapper.robot)) > ON_VIEWPOINT:
            self.drive(self.mapper.way_home(), done)

    def watch(self, goal: Position) -> Watch | None:
        """Return what takes the scans on the way, and stops the robot once nothing is left to see from its goal.

        None where there was nothing to see from the goal anyway.
        """
        mapper, spacing = self.mapper, self._spacing
        if nothing_to_see(mapper, goal, spacing):
            return None

        def watch(pose: Pose, scan: Scan) -> bool:
            began = time.process_time()
            mapper.integrate(scan, pose)
            mapper.update(pose)
            seen = nothing_to_see(mapper, goal, spacing)
            self.mapping_seconds += time.process_time() - began
            return seen

        return watch

    def observe(self) -> Observation:
        """Return what the robot knows where it stands."""
        return self.mapper.observe(image=self._images)

    def update(self) -> None:
        """Bring the graph up to date with what was sensed."""
        began = time.process_time()
        self.mapper.update(self.pose)
        self.mapping_seconds += time.process_time() - began

    def _take(self, leg: Leg) -> bool:
        began = time.process_time()
        for pose, scan in leg.sensed:
            self.mapper.integrate(scan, pose)
        self.mapping_seconds += time.process_time() - began
        self.pose = leg.pose
        self.distance += leg.distance
        self.collisions += leg.collisions
        self.positions.append(leg.pose.position)
        return leg.reached

    def _look(self) -> None:
        """Scan from here into the belief."""
        scan = self._simulator.scan()
        began = time.process_time()
        self.mapper.integrate(scan, self.pose)
        self.mapping_seconds += time.process_time() - began
