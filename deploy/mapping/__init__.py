"""From sensor messages to the common map: arrays and poses in, `common.mapping.mapper.Mapper` out."""

from deploy.mapping.robot_map import MapStatistics, RobotMap
from deploy.mapping.warmup import warm_up

__all__ = ["MapStatistics", "RobotMap", "warm_up"]
