"""The beginning of the corpus: what the software itself writes. ``python -m tests.fuzz.seeds`` makes it again."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
from PIL import Image

from common.config import MappingConfig, NetworkConfig, RunConfig
from common.geometry import Pose
from common.messages.experience import Delivery
from common.messages.schema import encode
from common.policies import onnx_file
from common.policies.policy_file import FORMAT, PolicyCard
from deploy.config import DeployConfig
from deploy.recording.writer import BagWriter
from deploy.ros2 import RELIABLE, message
from deploy.ros2.clouds import point_cloud
from deploy.ros2.conversions import occupancy_grid, odometry, path, transform, transform_message
from deploy.ros2.messages import serialize
from learner.run.event_file import PATTERN
from learner.run.records import RecordKind, encode_record
from learner.watch.metrics import Curves
from tests.common.messages import samples
from tests.fuzz.targets import CORPUS, ROS

RUN_TOML = """name = "fuzz"
seed = 3
[network]
width = 32
heads = 4
[maps]
train = ["generator:rooms?width=320&height=240"]
"""
ROBOT_TOML = """[decision]
planner = "dstar_lite"
[safety]
scan_timeout = 0.5
[topics]
scan = "/scan"
"""
MAP_YAML = """image: map.png
mode: trinary
resolution: 0.05
origin: [-1.5, 2.0, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def seeds() -> dict[str, dict[str, bytes]]:
    """Return the files of each target by their names."""
    rng = np.random.default_rng(0)
    deliveries = [samples.delivery(rng, number, steps=2, labels=bool(number)) for number in range(2)]
    report = Delivery("desk-0", 7, 2, samples.report())
    small = [*samples.small_messages(), samples.weights(), samples.view(rng), report, *deliveries]
    kinds = [RecordKind.DELIVERY, RecordKind.VERSION, RecordKind.DELIVERY]
    contents = [encode(report), (5).to_bytes(8, "little"), encode(report)]
    records = [
        encode_record(b"segment1", number, *each) for number, each in enumerate(zip(kinds, contents, strict=True))
    ]
    return {
        "message": {f"{number:02d}-{type(each).__name__}": encode(each) for number, each in enumerate(small)},
        "journal": {"whole": b"".join(records), "torn": b"".join(records)[:-9]},
        "episodes": {"lines": b'{"group": "train", "steps": 3}\n{"group": "evaluate", "distance": 1.5}\n'},
        "curves": {"events": _curves()},
        "run_config": {"small.toml": RUN_TOML.encode()},
        "robot_config": {"small.toml": ROBOT_TOML.encode()},
        "specification": {"default": RunConfig(name="fuzz").model_dump_json().encode()},
        "card": {"card": _card(b"weights").encode()},
        "onnx": {"model": onnx_file.with_card(b"\x08\x08", _card(b"\x08\x08"))},
        "image": _images(),
        "ros_map": {"map.yaml": MAP_YAML.encode()},
        "mcap": {compression: _bag(compression) for compression in ("none", "lz4", "zstd")},
        "cdr": _ros_messages(),
    }


def _card(data: bytes) -> str:
    made = PolicyCard("fuzz", "exploration", NetworkConfig(), MappingConfig(), 1, 10, 100, False, "", "")
    values = asdict(made) | {"network": made.network.model_dump(), "mapping": made.mapping.model_dump()}
    return json.dumps({"format": FORMAT, "sha256": hashlib.sha256(data).hexdigest(), **values})


def _curves() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        with Curves(Path(folder)) as curves:
            for update in range(3):
                curves.write(update, {"loss": 1.0})
        (file,) = Path(folder).glob(PATTERN)
        return file.read_bytes()


def _images() -> dict[str, bytes]:
    pixels = (np.arange(12 * 9) % 7 * 40).astype(np.uint8).reshape(9, 12)
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, mode in (("gray.png", "L"), ("palette.png", "P"), ("colour.png", "RGBA"), ("gray.pgm", "L")):
            file = Path(folder) / name
            Image.fromarray(pixels).convert(mode).save(file)
            found[name] = file.read_bytes()
    return found


def _ros_messages() -> dict[str, bytes]:
    grid = np.array([[-1, 0], [100, 0]], dtype=np.int8)
    made = {
        "sensor_msgs/msg/LaserScan": message(
            "sensor_msgs/msg/LaserScan", angle_max=0.2, angle_increment=0.1, range_max=9.0, ranges=[1.0, 2.0, 3.0]
        ),
        "sensor_msgs/msg/PointCloud2": point_cloud(1.0, "lidar", np.ones((3, 3), np.float32)),
        "nav_msgs/msg/Odometry": odometry(1.0, "odom", "base", Pose(1.0, 2.0, 0.5), (0.1, 0.2)),
        "nav_msgs/msg/OccupancyGrid": occupancy_grid(1.0, "map", grid, 0.1, (0.0, 0.0)),
        "nav_msgs/msg/Path": path(1.0, "map", [(0.0, 1.0), (1.0, 2.0)]),
        "tf2_msgs/msg/TFMessage": transform_message([transform(1.0, "map", "odom", Pose(1.0, 2.0, 0.5))]),
    }
    return {kind.rpartition("/")[2]: bytes([number]) + serialize(made[kind], kind) for number, kind in enumerate(ROS)}


def _bag(compression: str) -> bytes:
    text = serialize(message("std_msgs/msg/String", data="hello"), "std_msgs/msg/String")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "bag"
        with BagWriter(out, compression=compression, config=DeployConfig()) as bag:  # type: ignore[arg-type]
            channel = bag.add_topic("/words", "std_msgs/msg/String", RELIABLE)
            for second in range(3):
                bag.write(channel, text, (second + 1) * 10**9)
        return (out / "bag_0.mcap").read_bytes()


def main() -> None:
    for name, files in seeds().items():
        folder = CORPUS / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for file, content in files.items():
            (folder / file).write_bytes(content)


if __name__ == "__main__":
    main()
