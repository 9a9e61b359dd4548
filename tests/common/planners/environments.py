"""Environments in generated worlds, at their first scan."""

from actors.environment import Environment
from actors.maps.generators import make_generator
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from common.config import MappingConfig, RewardConfig, SimulatorConfig, TaskConfig
from common.planners.base import TaskName

MAPPING = MappingConfig()


def environment_in(
    name: str, number: int, task: TaskName = "exploration", mapping: MappingConfig = MAPPING, rays: int = 360
) -> Environment:
    simulator = GridSimulator(SimulatorConfig(name="grid", rays=rays), mapping.sensor_range)
    environment = Environment(simulator, mapping, make_goal(TaskConfig(name=task)), RewardConfig(), 200)
    environment.reset(make_generator(name, {}).world(number, 0.25), 0, on_lattice=False)
    return environment
