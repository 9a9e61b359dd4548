"""From sensor messages to the common map: arrays and poses in, `common.mapping.mapper.Mapper` out."""

from deploy.mapping.robot_map import MapStatistics, RobotMap

__all__ = ["MapStatistics", "RobotMap"]
