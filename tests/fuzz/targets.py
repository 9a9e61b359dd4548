"""Every decoder of what comes from outside, as a function of bytes that may raise its own error and no other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from actors.maps.images import read_pixels
from actors.maps.ros_map import read_map_server_file
from common.config.load import load_config
from common.config.names import config_from_message
from common.errors import CheckpointError, ConfigError, HDError, MapError, MessageError
from common.messages.experience import Delivery
from common.messages.replies import Ack, ControlReply, ControlRequest, Spec
from common.messages.schema import decode
from common.messages.stats import ActorStats, LearnerStats
from common.messages.view import EpisodeView
from common.messages.weights import Weights, WeightsNotice
from common.policies.policy_file import read_card
from deploy.profiles import load_deploy_config
from deploy.recording.errors import RecordingError
from deploy.recording.reader import read_bag, recorded_config, recover
from deploy.ros2.clouds import points_from
from deploy.ros2.conversions import grid_from, path_from, pose_from, scan_from, transforms_from
from deploy.ros2.errors import RosError
from deploy.ros2.messages import deserialize
from learner.run.episodes import damaged_lines, mend_episodes
from learner.run.event_file import mend_events
from learner.run.records import segment_name, segment_paths
from learner.run.repair import mend, review

CORPUS = Path(__file__).with_name("corpus")
MESSAGES = (
    *(Ack, ActorStats, ControlReply, ControlRequest, Delivery, EpisodeView),
    *(LearnerStats, Spec, Weights, WeightsNotice),
)
# What a robot does with each message right after it is decoded.
ROS = {
    "sensor_msgs/msg/LaserScan": scan_from,
    "sensor_msgs/msg/PointCloud2": points_from,
    "nav_msgs/msg/Odometry": pose_from,
    "nav_msgs/msg/OccupancyGrid": grid_from,
    "nav_msgs/msg/Path": path_from,
    "tf2_msgs/msg/TFMessage": transforms_from,
}


@dataclass(frozen=True)
class Target:
    """One decoder.

    Attributes:
        read: gets the bytes and an empty folder.
        refusals: errors with which it may refuse them.
    """

    read: Callable[[bytes, Path], object]
    refusals: tuple[type[HDError], ...]

    @property
    def name(self) -> str:
        return self.read.__name__

    def corpus(self) -> list[Path]:
        return sorted((CORPUS / self.name).iterdir())


def message(data: bytes, folder: Path) -> None:
    decode(data, *MESSAGES)


def journal(data: bytes, folder: Path) -> None:
    """What can be read is read, and after mending nothing is wrong any more."""
    path = folder / segment_name(1, b"segment1")
    path.write_bytes(data)
    found = review({1: path})
    mend({1: path}, found, folder / "damaged")
    again = review(segment_paths(folder))
    assert (again.sound, again.losses, again.torn) == (found.sound, [], 0)


def episodes(data: bytes, folder: Path) -> None:
    path = folder / "episodes.jsonl"
    path.write_bytes(data)
    mend_episodes(path, folder / "damaged")
    assert damaged_lines(path) == []


def curves(data: bytes, folder: Path) -> None:
    path = folder / "events"
    path.write_bytes(data)
    mend_events(path, folder / "damaged")
    assert mend_events(path, folder / "damaged") == 0


def run_config(data: bytes, folder: Path) -> None:
    (folder / "run.toml").write_bytes(data)
    load_config(folder / "run.toml", environment={})


def robot_config(data: bytes, folder: Path) -> None:
    (folder / "robot.toml").write_bytes(data)
    load_deploy_config(folder / "robot.toml", environment={})


def specification(data: bytes, folder: Path) -> None:
    config_from_message(data.decode("utf-8", "replace"), (), "")


def card(data: bytes, folder: Path) -> None:
    (folder / "policy.json").write_bytes(data)
    (folder / "policy.safetensors").write_bytes(b"weights")
    read_card(folder / "policy.safetensors")


def onnx(data: bytes, folder: Path) -> None:
    (folder / "policy.onnx").write_bytes(data)
    read_card(folder / "policy.onnx")


def image(data: bytes, folder: Path) -> None:
    (folder / "map.png").write_bytes(data)
    read_pixels(folder / "map.png")


def ros_map(data: bytes, folder: Path) -> None:
    (folder / "map.yaml").write_bytes(data)
    read_map_server_file(folder / "map.yaml")


def mcap(data: bytes, folder: Path) -> None:
    (folder / "bag.mcap").write_bytes(data)
    recorded_config(folder / "bag.mcap")
    for _ in read_bag(folder / "bag.mcap"):
        pass
    recover(folder / "bag.mcap", folder / "recovered")


def cdr(data: bytes, folder: Path) -> None:
    """The first byte says which message it is taken for."""
    kind, convert = list(ROS.items())[(data[0] if data else 0) % len(ROS)]
    convert(deserialize(data[1:], kind))


TARGETS = {
    target.name: target
    for target in (
        Target(message, (MessageError,)),
        Target(journal, ()),
        Target(episodes, ()),
        Target(curves, ()),
        Target(run_config, (ConfigError,)),
        Target(robot_config, (ConfigError,)),
        Target(specification, (MessageError, ConfigError)),
        Target(card, (CheckpointError,)),
        Target(onnx, (CheckpointError,)),
        Target(image, (MapError,)),
        Target(ros_map, (MapError,)),
        Target(mcap, (RecordingError,)),
        Target(cdr, (RosError,)),
    )
}
