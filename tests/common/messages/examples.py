"""The worked examples of docs/bus.md: ``python -m tests.common.messages.examples`` prints their blocks."""

import numpy as np

from common.messages.codec import pack_array
from common.messages.experience import Chunk, Delivery, End
from common.messages.replies import Ack
from common.messages.schema import encode
from common.observations.observation import ObservationBatch


def array() -> np.ndarray:
    """Two offsets, one lattice step apart."""
    return np.array([[0, 0], [64, 0]], dtype=np.int16)


def delivery() -> Delivery:
    """The smallest delivery: one step of exploration that ended nothing, in a graph of two viewpoints."""
    observations = ObservationBatch(
        count=np.array([2], dtype=np.int32),
        offsets=array(),
        utility=np.array([0, 5], dtype=np.uint16),
        visited=np.array([True, False]),
        beacon=np.array([False, True]),
        degree=np.array([1, 0], dtype=np.uint8),
        edge_count=np.array([1], dtype=np.int32),
        neighbours=np.array([1], dtype=np.uint16),
        bent_count=np.array([1], dtype=np.int32),
        bent=np.array([0], dtype=np.uint32),
        bent_length=np.array([1.25], dtype=np.float32),
        robot=np.array([0], dtype=np.int32),
        has_target=np.array([False]),
        target_known=np.array([False]),
        target_offset=np.zeros((1, 2), dtype=np.float32),
        link_count=np.array([0], dtype=np.int32),
        target_links=np.zeros(0, dtype=np.uint16),
        cell=np.array([0.0625], dtype=np.float32),
        reach=np.array([5.0], dtype=np.float32),
        route_count=np.array([1], dtype=np.int32),
        route=np.array([1], dtype=np.uint16),
    )
    chunk = Chunk(
        episode=0,
        first_step=0,
        observations=observations,
        beacons=np.array([1], dtype=np.int32),
        waypoints=np.array([1], dtype=np.int32),
        rewards=np.array([0.5], dtype=np.float32),
        versions=np.array([3], dtype=np.int64),
        probabilities=np.array([0.25], dtype=np.float32),
        labels=None,
        end=End.NONE,
    )
    return Delivery("desk-0", 4711, 0, chunk)


def ack() -> Ack:
    return Ack(sequence=0, stored=True, hold=0.0, error="", learner=815)


def blocks() -> dict[str, str]:
    """Name to hexadecimal lines, as they stand in the page."""
    data = {"array": pack_array(array()), "delivery": encode(delivery()), "ack": encode(ack())}
    return {
        name: "\n".join(value[i : i + 32].hex(" ") for i in range(0, len(value), 32)) for name, value in data.items()
    }


if __name__ == "__main__":
    for title, lines in blocks().items():
        print(f"```hex {title}\n{lines}\n```\n")
