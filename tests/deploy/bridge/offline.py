"""The decision loop without topics: a point robot in the grid simulator, time that is counted, and an exact map."""

from math import atan2, cos, sin

from actors.maps.grid_map import GridMap
from actors.simulators.grid import GridSimulator
from common.config import MappingConfig, SimulatorConfig
from common.errors import SimulatorError
from common.geometry import Pose
from common.mapping.mapper import Mapper
from deploy.bridge.decision import DecisionLoop
from deploy.bridge.mission import Mission
from deploy.bridge.planner_selector import make_planners
from deploy.config import DeployConfig
from deploy.mapping.robot_map import MapStatistics
from deploy.profiles import DEPLOY
from deploy.safety.health import HealthMonitor

MAPPING = {"resolution": 0.5, "sensor_range": 10.0, "viewpoint_spacing": 4.0, "beacon_range": 10.0, "robot_radius": 0.0}
TICK = 0.1


def settings(**sections) -> DeployConfig:
    """A configuration of the worlds' scale; sections as dictionaries."""
    return DEPLOY.resolve({"mapping": MAPPING, **sections})


class ExactMap:
    """A map without noise: every scan goes into the mapper as it is."""

    def __init__(self, config: MappingConfig, lattice_origin=(0.0, 0.0), target=None):
        self._config, self._lattice, self._target = config, lattice_origin, target
        self.pose = None
        self.integrated = 0
        self.reset(target)

    def add(self, scan, pose):
        self.pose = pose
        if scan is not None:
            self._mapper.integrate(scan, pose)
            self.integrated += 1
            self._have = True

    def refresh(self):
        if self.pose is None or not self._have:
            return None
        self._mapper.update(self.pose)
        return self._mapper

    @property
    def statistics(self):
        return MapStatistics(received=self.integrated, integrated=self.integrated)

    def set_target(self, target):
        self._mapper.target = target

    def reset(self, target=None):
        self._mapper = Mapper(self._config, lattice_origin=self._lattice, target=target)
        self._have = False


class Trial:
    """A robot that drives at 2 m/s to wherever the loop sends it, with a scan in every tick of 0.1 s."""

    def __init__(self, world: GridMap, config: DeployConfig, planner=None, make_map=ExactMap):
        self.now = 1000.0
        self.config = config
        self.simulator = GridSimulator(SimulatorConfig(name="grid", rays=360), config.mapping.sensor_range)
        self.pose = self.simulator.reset(world, 0)
        self.map = make_map(config.mapping, world.lattice_origin)
        self.mission = Mission(config.decision.task, config.decision.goal)
        self.health = HealthMonitor(config.safety)
        self.planners = make_planners(config, planner)
        self.loop = DecisionLoop(
            config.decision,
            config.mapping,
            config.safety,
            self.map,
            self.planners,
            self.mission,
            self.health,
            clock=lambda: self.now,
        )
        self.sensing = True
        self.frozen = self.in_other_hands = False
        self.distance = 0.0
        self.outcomes = []

    def tick(self):
        self.now += TICK
        if self.sensing:
            self.map.add(self.simulator.scan(), self.pose)
            self.health.heard_sensor(self.now)
        self.health.heard_pose(self.now, self.now, self.pose)
        outcome = self.loop.step(in_other_hands=self.in_other_hands)
        self.outcomes.append(outcome)
        if outcome.aim is not None and not self.frozen:
            self._drive(outcome.aim, 2.0 * TICK)
        return outcome

    def run(self, seconds, until=lambda outcome: False):
        """Tick until a condition holds; return the last outcome."""
        end = self.now + seconds
        while self.now < end:
            outcome = self.tick()
            if until(outcome):
                return outcome
        return outcome

    def _drive(self, waypoint, length):
        yaw = atan2(waypoint[1] - self.pose.y, waypoint[0] - self.pose.x)
        length = min(length, self.pose.distance_to(waypoint))
        there = Pose(self.pose.x + length * cos(yaw), self.pose.y + length * sin(yaw), yaw)
        try:
            self.simulator.place(there)
        except SimulatorError:
            return
        self.pose = there
        self.distance += length


def ended(outcome):
    return not outcome.orders.moving
