"""The file `metadata.yaml` of a ROS 2 bag, by which `ros2 bag` opens a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from deploy.ros2.messages import type_hash
from deploy.ros2.qos import QoS

_FOREVER = {"sec": 9223372036, "nsec": 854775807}
# Bags of humble are of version 5; version 9 writes a QoS as a map instead of text.
_VERSIONS = {"humble": 5}
_NEWEST = 9


@dataclass(slots=True)
class BagTopic:
    """One topic of a bag.

    Attributes:
        name: absolute.
        kind: message type.
        qos: that of its publisher.
        count: messages so far.
    """

    name: str
    kind: str
    qos: QoS
    count: int = 0


def qos_profiles(qos: QoS) -> list[dict[str, Any]]:
    """Return a QoS as bags hold it."""
    return [
        {
            "history": "keep_last",
            "depth": qos.depth,
            "reliability": "reliable" if qos.reliable else "best_effort",
            "durability": "transient_local" if qos.transient_local else "volatile",
            "deadline": _FOREVER,
            "lifespan": _FOREVER,
            "liveliness": "automatic",
            "liveliness_lease_duration": _FOREVER,
            "avoid_ros_namespace_conventions": False,
        }
    ]


def bag_metadata(file: str, topics: Sequence[BagTopic], start: int, end: int, distro: str) -> str:
    """Return the text of `metadata.yaml`; it is JSON, which every reader of YAML takes.

    Args:
        file: name of the storage file beside it.
        topics: with their counts.
        start: time of the first message, nanoseconds since 1970.
        end: time of the last one.
        distro: ROS 2 distribution whose readers must understand it.
    """
    version = _VERSIONS.get(distro, _NEWEST)
    count = sum(topic.count for topic in topics)
    span = {
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": max(end - start, 0)},
        "message_count": count,
    }
    described = []
    for topic in topics:
        profiles = qos_profiles(topic.qos)
        described.append(
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": profiles if version >= _NEWEST else json.dumps(profiles),
                    "type_description_hash": "" if distro == "humble" else type_hash(topic.kind, distro),
                },
                "message_count": topic.count,
            }
        )
    information = {
        "version": version,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [{"path": file, **span}],
        "custom_data": {},
        "ros_distro": distro,
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=2) + "\n"
