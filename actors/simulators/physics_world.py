"""One PyBullet physics server that holds one world: walls as a static triangle mesh, a floor, gravity."""

from __future__ import annotations

from typing import Any

from actors.maps.grid_map import GridMap
from actors.simulators.bullet import connect, disconnect, pybullet
from actors.simulators.grid import check_start
from actors.simulators.wall_mesh import Quads, wall_faces, wall_tops
from common.errors import ConfigError, SimulatorError

TIME_STEP = 1.0 / 240.0
# Collision groups; 2 is Bullet's own for static bodies.
ROBOT_GROUP, WALL_GROUP, FLOOR_GROUP = 1, 2, 64
# PyBullet takes at most 131,072 vertices per shape.
_QUADS_PER_MESH = 32_000
_LOWEST_WALL = 0.6
_WALL_COLOUR, _TOP_COLOUR, _FLOOR_COLOUR = (0.80, 0.78, 0.74, 1.0), (0.42, 0.45, 0.50, 1.0), (0.90, 0.91, 0.92, 1.0)


class PhysicsWorld:
    """A physics server with the walls of one map; every instance is independent of all others in the process.

    Attributes:
        client: PyBullet's client number of the server.
        walls: body numbers of the walls; one but for maps with more than 32,000 wall faces.
        floor: body number of the floor, an infinite plane at z = 0.
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
                f"wall_height: expected at least {_LOWEST_WALL} m, so that the robot's lidar meets walls; got {wall_height}"
            )
        self._wall_height = wall_height
        self._visible = visible or gui
        self.gui = gui
        self.client = connect(gui)
        self._open = True
        self.walls: tuple[int, ...] = ()
        self.floor = -1
        if gui:
            pybullet.configureDebugVisualizer(pybullet.COV_ENABLE_GUI, 0, physicsClientId=self.client)

    @property
    def is_open(self) -> bool:
        """Whether the physics server still runs."""
        return self._open

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
        faces = wall_faces(world, bottom=-0.1, top=self._wall_height)
        self.walls = tuple(self._static_mesh(*mesh, _WALL_COLOUR) for mesh in faces.chunks(_QUADS_PER_MESH))
        for body in self.walls:
            pybullet.changeDynamics(body, -1, lateralFriction=0.5, restitution=0.0, physicsClientId=client)
        self.floor = self._floor(world)
        if self._visible:
            self._show_tops(wall_tops(world, self._wall_height))
        self._drawing(True)

    def close(self) -> None:
        """Shut the physics server down; safe to call twice."""
        if self._open:
            self._open = False
            disconnect(self.client)

    def _drawing(self, on: bool) -> None:
        if self.gui:
            pybullet.configureDebugVisualizer(
                pybullet.COV_ENABLE_RENDERING, int(on), physicsClientId=self.client
            )

    def _static_mesh(
        self, vertices: list[list[float]], indices: list[int], colour: tuple[float, float, float, float]
    ) -> int:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=vertices,
            indices=indices,
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=self.client,
        )
        return self._static_body(shape, self._mesh_look(vertices, indices, colour))

    def _mesh_look(
        self, vertices: list[list[float]], indices: list[int], colour: tuple[float, float, float, float]
    ) -> int:
        if not self._visible:
            return -1
        return int(
            pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                vertices=vertices,
                indices=indices,
                rgbaColor=colour,
                specularColor=(0.1, 0.1, 0.1),
                physicsClientId=self.client,
            )
        )

    def _static_body(self, collision: int, look: int) -> int:
        body = pybullet.createMultiBody(
            baseMass=0.0,
            baseCollisionShapeIndex=collision,
            baseVisualShapeIndex=look,
            physicsClientId=self.client,
        )
        if body < 0 or (collision < 0 and look < 0):
            raise SimulatorError("PyBullet refused the world's mesh: report the map")
        return int(body)

    def _floor(self, world: GridMap) -> int:
        client = self.client
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        look = -1
        if self._visible:
            (x, y), (width, height) = world.origin, world.size
            corners = [[x, y, 0.0], [x + width, y, 0.0], [x + width, y + height, 0.0], [x, y + height, 0.0]]
            look = self._mesh_look(corners, [0, 1, 2, 0, 2, 3], _FLOOR_COLOUR)
        body = self._static_body(plane, look)
        pybullet.changeDynamics(body, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
        everything: Any = -1
        pybullet.setCollisionFilterGroupMask(body, -1, FLOOR_GROUP, everything, physicsClientId=client)
        return body

    def _show_tops(self, tops: Quads) -> None:
        for vertices, indices in tops.chunks(_QUADS_PER_MESH):
            self._static_body(-1, self._mesh_look(vertices, indices, _TOP_COLOUR))
