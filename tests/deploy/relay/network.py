"""Both sides of a relay: plain nodes of rclpy, and nodes of ours on Zenoh."""

import contextlib
import threading
from unittest import mock

import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed: `make test-ros` runs these")

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from deploy.profiles import load_deploy_config
from deploy.relay import relay as relay_module
from deploy.relay.relay import Relay
from deploy.ros2 import Node
from tests.common.bus.processes import eventually, free_port

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


def robot(domain, *overrides, profile="bare"):
    """Configuration of a robot whose relay is the router of a Zenoh network of its own."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = [f"ros.domain={domain}", f"ros.listen={endpoint}", "ros.connect=", *overrides]
    return load_deploy_config(overrides=settings, profile=profile)


@contextlib.contextmanager
def dds_node(name, domain, namespace="/"):
    """A node written with rclpy alone, which knows nothing of relays."""
    context = rclpy.Context()
    context.init(domain_id=domain)
    node = rclpy.create_node(name, namespace=namespace, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin():
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield node
    finally:
        executor.shutdown(2.0)
        thread.join(5.0)
        node.destroy_node()
        context.try_shutdown()


@contextlib.contextmanager
def running_relay(config):
    """A relay at work in a thread; it does not wait for others of its name, to save time."""
    stop = threading.Event()
    with mock.patch.object(relay_module, "DISCOVERY_SECONDS", 0.0):
        made = Relay(config)
    with made as relay:
        thread = threading.Thread(target=relay.run, args=(stop,))
        thread.start()
        try:
            yield relay
        finally:
            stop.set()
            thread.join(10.0)


def bridge_node(config, name="hd_bridge"):
    """A node on the Zenoh side, where the bridge is."""
    ros = config.ros
    return Node(ros.model_copy(update={"connect": ros.listen or ros.connect, "listen": ()}), name)


def repeat(send, until, timeout=20.0) -> bool:
    """Send until a condition holds: discovery takes a moment."""

    def again():
        send()
        return until()

    return eventually(again, timeout)
