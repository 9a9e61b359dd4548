from deploy.needs import needs_of
from deploy.profiles import load_deploy_config


def test_the_bridge_needs_a_sensor_and_a_pose_under_the_names_of_the_robot():
    sensor, pose = needs_of(load_deploy_config(overrides=["ros.namespace=robot1", "topics.scan=front/scan"]))
    assert (sensor.name, sensor.topic, sensor.kind) == ("scan", "/robot1/front/scan", "sensor_msgs/msg/LaserScan")
    assert (pose.name, pose.topic) == ("odometry", "/odom")
    sensor, pose = needs_of(load_deploy_config(profile="nav2"))
    assert (sensor.name, pose.name) == ("map", "tf")


def test_a_topic_that_is_switched_off_is_needed_all_the_same():
    sensor, _ = needs_of(load_deploy_config(overrides=["topics.scan="]))
    assert (sensor.name, sensor.topic) == ("scan", "")
