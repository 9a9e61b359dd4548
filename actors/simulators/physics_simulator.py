"""What both fidelities of the `pybullet` simulator share: the physics world, with a robot in it, and its lidar."""

from __future__ import annotations

from actors.maps.grid_map import GridMap
from actors.simulators.beams import BeamPattern
from actors.simulators.lidar import Lidar
from actors.simulators.physics_world import PhysicsWorld
from actors.simulators.robot import Robot
from common.config import SimulatorConfig
from common.errors import SimulatorError


class PhysicsSimulator:
    """A simulator that senses in a PyBullet world; how the robot moves is said by subclasses."""

    def __init__(
        self, config: SimulatorConfig, sensor_range: float, *, gui: bool = False, visible: bool = False
    ) -> None:
        """Open a physics server.

        Args:
            config: sensor and speed.
            sensor_range: metres.
            gui: open PyBullet's window.
            visible: give the world colours, for rendering without a window.
        """
        self._config = config
        self.physics = PhysicsWorld(config.wall_height, gui=gui, visible=visible)
        self._beams = BeamPattern(config.rays, sensor_range, config.range_noise)
        self._lidar = Lidar(self._beams, config.lidar_layers, config.wall_height)
        self._world: GridMap | None = None
        self._robot: Robot | None = None

    def set_sensor_range(self, metres: float) -> None:
        """Let the sensor reach so far from the next scan on."""
        self._lidar.set_range(metres)

    def close(self) -> None:
        """Shut the physics server down; safe to call twice."""
        self._robot = None
        self.physics.close()

    def _load(self, world: GridMap, seed: int) -> None:
        """Load a world, and draw the noise of its scans from a seed."""
        self.physics.load(world)
        self._world = world
        self._beams.reseed(seed)
        self._lidar.forget()

    def _loaded(self) -> tuple[Robot, GridMap]:
        if self._robot is None or self._world is None:
            raise SimulatorError("the simulator has no world: call reset(world, seed) first")
        return self._robot, self._world
