"""Where the inputs that have not come yet are waited for, so that an operator sees a topic that is misspelt."""

from __future__ import annotations

from dataclasses import dataclass

from deploy.config import DeployConfig
from deploy.ros2.names import namespace, topic_name


@dataclass(frozen=True, slots=True)
class Awaited:
    """What follows "no scan received yet" in a message, and "no pose received yet"; empty where it is not known."""

    sensor: str = ""
    pose: str = ""


def awaited(config: DeployConfig) -> Awaited:
    """Return the topics of a configuration and what to do where nothing comes from them."""

    def on(setting: str) -> str:
        name = getattr(config.topics, setting)
        topic = topic_name(name, namespace(config.ros.namespace), config.topics.remap)
        return f" on {topic}: start what publishes it, or correct topics.{setting} (`hd-deploy topics` lists them all)"

    frames = config.frames
    by_tf = (
        f", TF does not lead from {frames.map!r} to {frames.base!r}: start what publishes it on {config.topics.tf}, or "
        "correct frames.map, frames.odom and frames.base"
    )
    sensor = {"scan": "scan", "points": "points", "grid": "map"}[config.sensing.source]
    return Awaited(on(sensor), by_tf if config.sensing.pose == "tf" else on("odometry"))
