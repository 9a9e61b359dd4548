"""A robot that is written with rclpy alone: the simulated one of `hd-deploy robot`, behind typed topics in DDS.

It is a program of its own, `python -m tests.deploy.relay.dds_robot OPTIONS CONFIG` (both JSON), and knows no Zenoh.
"""

import array
import json
import math
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from common.system.signals import stopping_signals
from deploy.config import DeployConfig
from deploy.robot.options import RobotOptions
from deploy.robot.pace import Pace
from deploy.robot.simulation import SimulatedRobot

TRUTH = "truth"
"""std_msgs/String: JSON of what only a simulation knows, and the monotonic time at which it was sent."""


class DdsRobot(Node):
    """The node of the robot's base and lidar; all names are relative, so that it can live in a namespace."""

    def __init__(self, robot: SimulatedRobot, namespace: str) -> None:
        super().__init__("base", namespace=namespace)
        self._robot = robot
        self._epoch = time.time()
        self._odometry = self.create_publisher(Odometry, "odom", 10)
        self._scan = self.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._truth = self.create_publisher(String, TRUTH, 10)
        self.create_subscription(Twist, "cmd_vel", self._drive, 10)

    def publish(self, moment) -> None:
        now = self._epoch + moment.time
        if moment.odometry_due:
            self._odometry.publish(self._odometry_of(now, moment))
        if moment.scan is not None:
            self._scan.publish(self._scan_of(now, moment.scan))
            self._truth.publish(String(data=self._truth_of(moment)))

    def _drive(self, twist: Twist) -> None:
        robot = self._robot
        robot.base.receive(twist.linear.x, twist.angular.z, time.monotonic(), robot.time)

    def _odometry_of(self, now, moment) -> Odometry:
        odometry = Odometry(child_frame_id="base_link")
        self._head(odometry.header, now, "map")
        pose = moment.estimate
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = pose.x, pose.y
        turn = odometry.pose.pose.orientation
        turn.z, turn.w = math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0)
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = moment.velocity
        return odometry

    def _scan_of(self, now, scan) -> LaserScan:
        message = LaserScan(
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment,
            angle_increment=scan.angle_increment,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=array.array("f", scan.ranges.tolist()),
        )
        self._head(message.header, now, "laser")
        return message

    def _truth_of(self, moment) -> str:
        robot = self._robot
        return json.dumps(
            {
                "time": moment.time,
                "x": moment.truth.x,
                "y": moment.truth.y,
                "speed": moment.velocity[0],
                "turn_rate": moment.velocity[1],
                "distance": robot.distance,
                "collisions": robot.collisions,
            }
        )

    @staticmethod
    def _head(header, now: float, frame: str) -> None:
        header.frame_id = frame
        header.stamp.sec, header.stamp.nanosec = divmod(round(now * 1e9), 10**9)


def main() -> None:
    options, config = RobotOptions.model_validate_json(sys.argv[1]), DeployConfig.model_validate_json(sys.argv[2])
    stop = threading.Event()
    with stopping_signals(stop.set, stop.is_set), SimulatedRobot(options, config) as robot:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = DdsRobot(robot, config.ros.namespace or "/")
        threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
        pace = Pace(options.speed_factor)
        while not stop.is_set():
            node.publish(robot.step(time.monotonic()))
            pace.wait(robot.time, stop)
        rclpy.shutdown()


if __name__ == "__main__":
    main()
