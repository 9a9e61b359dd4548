"""What the simulated robot is and how well its sensors work."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from common.config import Positive, Section
from deploy.config import DrivingConfig, NonNegative
from deploy.network_config import TopicsConfig
from deploy.robot import defaults


class RobotOptions(Section):
    """Options of `hd-deploy robot`; topics and frames are those of the bridge's `DeployConfig`."""

    map: str = defaults.MAP
    """World: a map file (`plan.yaml?start=1.5,2`), a folder of them, or `generator:NAME[?key=value&...]`."""
    metres_per_pixel: Positive | None = None
    """Scale of images and of generated worlds; when not given that of their set, else `defaults.METRES_PER_PIXEL`."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Number of the world in its source, and seed of all noise."""
    speed_factor: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """How much faster than real time the robot lives; below 1 in slow motion."""
    max_speed: Positive = defaults.MAX_SPEED
    """Maximum speed of the base, m/s."""
    max_turn_rate: Positive = defaults.MAX_TURN_RATE
    """Maximum turn rate of the base, rad/s."""
    acceleration: Positive = defaults.ACCELERATION
    """How fast the base gains speed, m/s2."""
    deceleration: Positive = defaults.DECELERATION
    """How fast it brakes, m/s2."""
    turn_acceleration: Positive = defaults.TURN_ACCELERATION
    """Likewise of turns, rad/s2."""
    command_timeout: Positive = defaults.COMMAND_TIMEOUT
    """The base stops this long after the last velocity, as real bases do: seconds of wall-clock time, or of the robot's
    in slow motion."""
    rays: Annotated[int, Field(ge=16, le=7200)] = defaults.RAYS
    """Beams of the lidar per turn."""
    layers: Literal[1, 16] | None = None
    """Layers of the lidar; when not given 16 where the profile has a topic of point clouds, else 1."""
    scan_rate: Annotated[float, Field(gt=0.0, le=30.0)] = defaults.SCAN_RATE
    """Scans or clouds per second, Hz."""
    odometry_rate: Annotated[float, Field(gt=0.0, le=60.0)] = defaults.ODOMETRY_RATE
    """Odometry messages and transforms per second, Hz."""
    map_rate: Annotated[float, Field(gt=0.0, le=10.0)] = defaults.MAP_RATE
    """Grids of the robot's own mapping per second, Hz."""
    people: Annotated[int, Field(ge=0, le=200)] = 0
    """People who walk about, pillars of 0.25 m radius to the lidar; they stop before the robot."""
    range_noise: NonNegative = 0.0
    """Standard deviation of the ranges, metres."""
    odometry_drift: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    """Error of the odometry: metres per metre, and radians per square root of a metre."""
    sensor_latency: NonNegative = 0.0
    """Delay between the stamp of a sensor message and its arrival, seconds of the robot."""
    command_latency: NonNegative = 0.0
    """Delay between the arrival of a command and its effect, seconds of the robot."""
    follow: bool | None = None
    """Drive to waypoints itself, as the CMU stack and nav2 do; when not given, where the bridge does not drive."""

    def lidar_layers(self, topics: TopicsConfig) -> Literal[1, 16]:
        """Layers of the lidar behind the topics of a profile."""
        return self.layers or (16 if topics.points else 1)

    def follows(self, driving: DrivingConfig) -> bool:
        """Whether the robot drives to waypoints itself."""
        return not driving.enabled if self.follow is None else self.follow
