"""An input that never came is told with its topic and what to do."""

import pytest

from deploy.profiles import load_deploy_config
from deploy.safety.awaited import awaited
from deploy.safety.health import HealthMonitor
from deploy.safety.rules import GateRules


@pytest.mark.parametrize(
    ("profile", "settings", "sensor", "pose"),
    [
        ("bare", [], "/scan", "/odom"),
        ("bare", ["topics.scan=lidar/scan", "ros.namespace=robot1"], "/robot1/lidar/scan", "/odom"),
        ("cmu", [], "/registered_scan", "/state_estimation"),
        ("nav2", [], "/map", "/tf"),
        ("nav2", ["frames.base=base_footprint"], "topics.map", "to 'base_footprint'"),
    ],
)
def test_the_operator_reads_where_the_bridge_waits(profile, settings, sensor, pose):
    config = load_deploy_config(None, settings, {}, profile)
    health = HealthMonitor(config.safety, None, config.sensing.source, awaited(config))
    told = [fault.reason for fault in health.check(0.0)]
    assert sensor in told[0]
    assert pose in told[1]
    rules = GateRules(config.safety, config.sensing.source, 0.0, drives=True, awaited=awaited(config))
    rules.command(0.0, 0.0, 0.0)
    assert sensor in rules.decide(0.0).reason
    rules.sensor_time = 0.0
    assert pose in rules.decide(0.0).reason
