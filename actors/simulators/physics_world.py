"""One PyBullet physics server that holds one world: walls as a static triangle mesh, a floor, gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from actors.maps.grid_map import GridMap
from actors.simulators.bullet import collision_mesh, connect, disconnect, pybullet, visual_mesh
from actors.simulators.grid import check_start
from actors.simulators.wall_mesh import wall_faces, wall_tops
from common.errors import ConfigError, SimulatorError

TIME_STEP = 1.0 / 240.0
# Collision groups; 2 is Bullet's own for static bodies, and the robot is in 1, that of all others.
WALL_GROUP, FLOOR_GROUP = 2, 64
# PyBullet takes at most 131,072 vertices per shape.
_QUADS_PER_MESH = 32_000
_LOWEST_WALL, _BELOW_FLOOR = 0.6, -0.1
_PILLAR_COLOUR = (0.85, 0.55, 0.20, 1.0)
_WALL_COLOUR, _TOP_COLOUR, _FLOOR_COLOUR = (0.80, 0.78, 0.74, 1.0), (0.42, 0.45, 0.50, 1.0), (0.90, 0.91, 0.92, 1.0)


class PhysicsWorld:
    """A physics server with the walls of one map; every instance is independent of all others in the process.

    Attributes:
        client: PyBullet's client number of the server.
        walls: body numbers of the walls; one but for maps with more than 32,000 wall faces.
        pillars: body numbers of what moves about, see `add_pillars`.
        floor: body number of the floor, an infinite plane at z = 0.
        visible: whether the world has colours to look at.
    """

    def __init__(self, wall_height: float, *, gui: bool = False, visible: bool = False) -> None:
        """Open a physics server.

        Args:
            wall_height: metres.
            gui: open PyBullet's window.
            visible: give walls and floor colours, for rendering; always so with ``gui``.

        Raises:
            ConfigError: the walls are too low for the robot's lidar to see.
            SimulatorError: the server or its window cannot be opened.
        """
        if wall_height < _LOWEST_WALL:
            raise ConfigError(
                f"wall_height: expected at least {_LOWEST_WALL} m, so that the lidar meets walls; got {wall_height}"
            )
        self._wall_height = wall_height
        self.visible = visible or gui
        self.gui = gui
        self.client = connect(gui)
        self._open = True
        self.walls: tuple[int, ...] = ()
        self.pillars: tuple[int, ...] = ()
        self._pillar_middle = 0.0
        self.floor = -1
        if gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=self.client)

    def load(self, world: GridMap) -> None:
        """Replace whatever is there by the walls and floor of a map.

        The server starts from an empty state, so that runs repeat bit by bit and memory does not grow.
        """
        if not self._open:
            raise SimulatorError("the simulator is closed: make a new one")
        check_start(world)
        client = self.client
        self._drawing(False)
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP, deterministicOverlappingPairs=1, physicsClientId=client
        )
        self.walls = self._walls(world)
        self.pillars = ()
        self.floor = self._floor(world)
        if self.visible:
            self._show_tops(world)
        self._drawing(True)

    def add_pillars(self, positions: Sequence[tuple[float, float]], radius: float, height: float) -> None:
        """Put round pillars on the floor, metres; the lidar sees them as walls, and `move_pillars` moves them."""
        client = self.client
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_CYLINDER, radius=radius, height=height, physicsClientId=client
        )
        look = -1
        if self.visible:
            look = pybullet.createVisualShape(
                pybullet.GEOM_CYLINDER, radius=radius, length=height, rgbaColor=_PILLAR_COLOUR, physicsClientId=client
            )
        self.pillars = tuple(self._static_body(shape, look) for _ in positions)
        self._pillar_middle = 0.5 * height
        self.move_pillars(positions)

    def move_pillars(self, positions: Sequence[tuple[float, float]]) -> None:
        """Set the pillars somewhere else, metres, each by its number; nothing stops them."""
        for body, (x, y) in zip(self.pillars, positions, strict=True):
            place = (x, y, self._pillar_middle)
            pybullet.resetBasePositionAndOrientation(body, place, (0.0, 0.0, 0.0, 1.0), physicsClientId=self.client)

    def close(self) -> None:
        """Shut the physics server down; safe to call twice."""
        if self._open:
            self._open = False
            disconnect(self.client)

    def _drawing(self, on: bool) -> None:
        if self.gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_RENDERING, int(on), physicsClientId=self.client)

    def _static_body(self, collision: int, look: int) -> int:
        body = pybullet.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=collision,
            baseVisualShapeIndex=look,
            physicsClientId=self.client,
        )
        if body < 0 or (collision < 0 and look < 0):
            raise SimulatorError("PyBullet refused a mesh of the world: report the map")
        return int(body)

    def _walls(self, world: GridMap) -> tuple[int, ...]:
        bodies = []
        for vertices, indices in wall_faces(world, _BELOW_FLOOR, self._wall_height).chunks(_QUADS_PER_MESH):
            shape = collision_mesh(self.client, vertices, indices)
            look = visual_mesh(self.client, vertices, indices, _WALL_COLOUR) if self.visible else -1
            body = self._static_body(shape, look)
            pybullet.changeDynamics(body, -1, lateralFriction=0.5, restitution=0.0, physicsClientId=self.client)
            bodies.append(body)
        return tuple(bodies)

    def _floor(self, world: GridMap) -> int:
        (x, y), (width, height) = world.origin, world.size
        corners = np.array([[x, y, 0.0], [x + width, y, 0.0], [x + width, y + height, 0.0], [x, y + height, 0.0]])
        # With no look of its own, a plane gets a large one, which costs half a millisecond even when nobody looks.
        look = visual_mesh(self.client, corners, np.array([0, 1, 2, 0, 2, 3]), _FLOOR_COLOUR)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self.client)
        body = self._static_body(plane, look)
        pybullet.changeDynamics(body, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=self.client)
        pybullet.setCollisionFilterGroupMask(body, -1, FLOOR_GROUP, -1, physicsClientId=self.client)
        return body

    def _show_tops(self, world: GridMap) -> None:
        for vertices, indices in wall_tops(world, self._wall_height).chunks(_QUADS_PER_MESH):
            self._static_body(-1, visual_mesh(self.client, vertices, indices, _TOP_COLOUR))
