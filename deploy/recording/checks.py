"""What a recording tells about the integration of a robot: rates, gaps, frames, stamps, values of grids."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.errors import MappingError
from deploy.config import DeployConfig, SensingConfig
from deploy.needs import Need, needs_of
from deploy.recording.reader import Recorded
from deploy.ros2.conversions import cloud_note, points_from, scan_from, scan_note, transforms_from
from deploy.ros2.errors import RosError
from deploy.ros2.messages import Message, deserialize, seconds, typestore
from deploy.ros2.names import namespace, topic_name
from deploy.ros2.no_return import understood
from deploy.tf.transform import Transform

_KNOWN_GRID_VALUES = frozenset({-1, 0, 100})
_SKEW = 1.0
# Topics that a warning names.
_NAMED = 12
# Sentences about the messages of one topic, the most frequent ones.
_SHOWN = 3


@dataclass(slots=True)
class TopicCheck:
    """What was seen on one topic; times in seconds.

    Attributes:
        kind: message type.
        count: messages.
        invalid: messages that could not be read.
        first: arrival of the first one, since 1970.
        last: arrival of the last one.
        gap: longest time between two.
        frames: frame of the header, or parent -> child of transforms, with the number of messages.
        backwards: stamps older than the one before.
        delay_least: least arrival minus stamp; negative when the stamps' clock is ahead.
        delay_most: most arrival minus stamp.
        values: of grids: number of cells by value.
        shapes: of grids: sizes seen, columns x rows.
        figures: of scans, clouds and odometry: sums of what the notes are made from.
        stamp: the last one.
        strange: what the bridge would say of a scan or cloud that it can use all the same, or why it cannot.
    """

    kind: str
    count: int = 0
    invalid: int = 0
    first: float = 0.0
    last: float = 0.0
    gap: float = 0.0
    frames: Counter[str] = field(default_factory=Counter)
    backwards: int = 0
    delay_least: float = math.inf
    delay_most: float = -math.inf
    values: Counter[int] = field(default_factory=Counter)
    shapes: Counter[str] = field(default_factory=Counter)
    figures: Counter[str] = field(default_factory=Counter)
    stamp: float = -math.inf
    strange: Counter[str] = field(default_factory=Counter)

    @property
    def rate(self) -> float:
        """Messages per second between the first and the last."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0

    def notes(self) -> str:
        """Return what is particular to the type, in words."""
        figures, count = self.figures, max(self.count - self.invalid, 1)
        if self.values:
            total = sum(self.values.values())
            shares = {
                "unknown": self.values[-1],
                "free": self.values[0],
                "occupied": self.values[100],
                "other": total - sum(self.values[value] for value in _KNOWN_GRID_VALUES),
            }
            text = ", ".join(f"{name} {100.0 * cells / total:.1f} %" for name, cells in shares.items())
            return f"{', '.join(self.shapes)}: {text}"
        if figures["beams"]:
            beams = figures["beams"]
            return (
                f"{beams / count:.0f} beams, {100.0 * figures['returns'] / beams:.0f} % returns, "
                f"{100.0 * figures['nan'] / beams:.0f} % NaN, {100.0 * figures['near'] / beams:.0f} % below range_min"
            )
        if figures["points"]:
            return f"{figures['points'] / count:.0f} points"
        if self.kind == "nav_msgs/msg/Odometry":
            return f"up to {figures['speed_mm'] / 1000.0:.2f} m/s"
        return ""


class Checks:
    """Looks at every message of a recording once.

    Usage::

        checks = Checks(config)
        for recorded in read_bag(path):
            checks.add(recorded)
        for warning in checks.warnings(): ...

    Attributes:
        topics: by name.
    """

    def __init__(self, config: DeployConfig) -> None:
        """Check against the parameters of a bridge."""
        self.topics: dict[str, TopicCheck] = {}
        self._config = config
        self._distro = config.ros.distro

    @property
    def duration(self) -> float:
        """Seconds from the first message to the last."""
        return self._end - min((check.first for check in self.topics.values()), default=self._end)

    @property
    def _end(self) -> float:
        return max((check.last for check in self.topics.values()), default=0.0)

    def add(self, recorded: Recorded) -> None:
        """Look at a message."""
        arrival = recorded.time * 1e-9
        check = self.topics.get(recorded.topic)
        if check is None:
            check = self.topics[recorded.topic] = TopicCheck(recorded.kind, first=arrival, last=arrival)
        check.gap = max(check.gap, arrival - check.last)
        check.last = max(check.last, arrival)
        check.count += 1
        if recorded.kind not in typestore(self._distro).fielddefs:
            return
        try:
            message = deserialize(recorded.payload, recorded.kind, self._distro)
            _look(check, message, arrival, self._config.sensing)
        except (RosError, MappingError) as error:
            check.invalid += 1
            check.strange[str(error)] += 1

    def warnings(self) -> list[str]:
        """Return what a bridge with these parameters would stumble over, one line each."""
        found: list[str] = []
        safety, frames = self._config.safety, self._config.frames
        limits = safety.scan_timeout, safety.pose_timeout
        for need, limit in zip(needs_of(self._config), limits, strict=True):
            name = need.topic
            check = self.topics.get(name)
            if check is None:
                found.append(
                    f"no message on {name or '(no topic)'}, which the bridge needs (topics.{need.name}); "
                    f"{self._instead_of(need)}"
                )
            elif need.name != "map" and (gap := max(check.gap, self._end - check.last)) > limit:
                found.append(f"{name} paused for {gap:.2f} s: the robot would be stopped after {limit:g} s")
        for name, check in self.topics.items():
            if check.invalid:
                found.append(f"{name}: {check.invalid} of {check.count} messages cannot be read or make no sense")
            found += [f"{name}: {text} ({count} messages)" for text, count in check.strange.most_common(_SHOWN)]
            if check.backwards:
                found.append(f"{name}: {check.backwards} stamps are older than the one before")
            if check.delay_most > _SKEW or check.delay_least < -_SKEW:
                found.append(
                    f"{name}: stamps are between {check.delay_least:.2f} and {check.delay_most:.2f} s behind the "
                    "arrival: another clock, or simulation time"
                )
            found += self._frame_warnings(name, check, frames.map)
            if check.values:
                found += self._grid_warnings(name, check)
            if check.figures["beams"] and check.figures["returns"] == 0:
                found.append(f"{name}: no beam ever returned from within its range")
        return found

    def _name(self, what: str) -> str:
        topics = self._config.topics
        return topic_name(getattr(topics, what), namespace(self._config.ros.namespace), topics.remap)

    def _instead_of(self, need: Need) -> str:
        """Say what the recording holds in the place of a topic that is not there."""
        alike = [name for name, check in self.topics.items() if check.kind == need.kind]
        if alike:
            return f"{need.kind} is there on {_some(alike)}: --set topics.{need.name}={alike[0]}"
        return f"there are {_some(list(self.topics)) or 'no topics at all'}"

    def _frame_warnings(self, name: str, check: TopicCheck, map_frame: str) -> list[str]:
        sensing = self._config.sensing
        in_map = {self._name("odometry")} if sensing.pose == "odometry" else set()
        if sensing.source == "grid":
            in_map.add(self._name("map"))
        if sensing.source == "points" and sensing.points_frame == "map":
            in_map.add(self._name("points"))
        strange = [frame for frame in check.frames if frame != map_frame]
        if name in in_map and strange:
            return [
                f"{name} is in the frame {', '.join(map(repr, strange))} and not in {map_frame!r}: the bridge takes an "
                "odometry's frame for the map, and needs the transforms of all other frames (set frames.map, or "
                "sensing.pose=tf)"
            ]
        if len(check.frames) > 1 and "->" not in next(iter(check.frames)):
            return [f"{name} changes its frame: {', '.join(check.frames)}"]
        return []

    def _grid_warnings(self, name: str, check: TopicCheck) -> list[str]:
        sensing = self._config.sensing
        total = sum(check.values.values())
        between = sum(n for value, n in check.values.items() if sensing.grid_free < value < sensing.grid_occupied)
        wrong = sum(n for value, n in check.values.items() if not -1 <= value <= 100)
        found = []
        if between > 0.01 * total:
            found.append(
                f"{name}: {100.0 * between / total:.1f} % of the cells are between sensing.grid_free "
                f"({sensing.grid_free}) and sensing.grid_occupied ({sensing.grid_occupied}) and count as unknown"
            )
        if wrong:
            found.append(f"{name}: {wrong} cells have values outside -1 to 100")
        return found


def _some(names: list[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def histogram(values: Mapping[int, int], bins: int = 10) -> list[tuple[str, float]]:
    """Return the shares of a grid's values: unknown first, then `bins` equal ranges from 0 to 100."""
    total = max(sum(values.values()), 1)
    edges = np.linspace(0, 101, bins + 1).astype(int)
    rows = [("-1", values.get(-1, 0) / total)]
    for low, high in itertools.pairwise(edges):
        rows.append((f"{low}-{high - 1}", sum(values.get(value, 0) for value in range(low, high)) / total))
    return rows


def _look(check: TopicCheck, message: Message, arrival: float, sensing: SensingConfig) -> None:
    if check.kind == "tf2_msgs/msg/TFMessage":
        for _, parent, child, translation, rotation in transforms_from(message):
            check.frames[f"{parent} -> {child}"] += 1
            Transform.checked(translation, rotation)
        return
    header: Any = getattr(message, "header", None)
    if header is not None:
        check.frames[header.frame_id.lstrip("/")] += 1
        time = seconds(header.stamp)
        check.backwards += time < check.stamp
        check.stamp = time
        # A latched map may be as old as it likes.
        if check.kind != "nav_msgs/msg/OccupancyGrid":
            check.delay_least = min(check.delay_least, arrival - time)
            check.delay_most = max(check.delay_most, arrival - time)
    if check.kind == "nav_msgs/msg/OccupancyGrid":
        values, counts = np.unique(message.data, return_counts=True)
        check.values = Counter(dict(zip(values.tolist(), counts.tolist(), strict=True)))
        check.shapes[f"{message.info.width} x {message.info.height} of {message.info.resolution:.3g} m"] += 1
    elif check.kind == "sensor_msgs/msg/LaserScan":
        _, strange = understood(scan_from(message), sensing.no_return)
        check.strange.update(filter(None, (scan_note(message), strange)))
        ranges = np.asarray(message.ranges)
        check.figures["beams"] += ranges.size
        check.figures["nan"] += int(np.isnan(ranges).sum())
        check.figures["near"] += int((ranges < message.range_min).sum())
        check.figures["returns"] += int(((ranges >= message.range_min) & (ranges < message.range_max)).sum())
    elif check.kind == "sensor_msgs/msg/PointCloud2":
        check.figures["points"] += len(points_from(message))
        check.strange.update(filter(None, (cloud_note(message),)))
    elif check.kind == "nav_msgs/msg/Odometry":
        speed = math.hypot(message.twist.twist.linear.x, message.twist.twist.linear.y)
        if math.isfinite(speed):
            check.figures["speed_mm"] = max(check.figures["speed_mm"], round(1000.0 * speed))
