"""Quality of service: how ROS 2 names it, and what of it Zenoh knows."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class QoS:
    """Quality of service of one publisher or subscription, as in ROS 2.

    Attributes:
        reliable: RELIABLE, else BEST_EFFORT.
        transient_local: late subscribers get the last `depth` messages (TRANSIENT_LOCAL), else VOLATILE.
        depth: KEEP_LAST so many messages; a subscriber that is slower than its publisher loses the oldest.
    """

    reliable: bool = True
    transient_local: bool = False
    depth: int = 10

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise ValueError(f"depth must be at least 1, got {self.depth}: keep one message or more")


RELIABLE = QoS()
"""ROS 2's default for topics: reliable, volatile, the last 10."""
SENSOR = QoS(reliable=False, depth=5)
"""ROS 2's sensor data: best effort, volatile, the last 5."""
LATCHED = QoS(transient_local=True, depth=1)
"""Maps and static transforms: reliable, transient local, the last one."""
STATIC = QoS(transient_local=True, depth=100)
"""`/tf_static`, where every broadcaster latches its own: reliable, transient local, the last 100."""
