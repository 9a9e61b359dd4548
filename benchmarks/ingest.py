"""How fast experience and weights cross the bus: ``python -m benchmarks.ingest``."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.children import child_environment
from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.session import new_incarnation, open_client_session, open_learner_session
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.config import BusConfig
from common.messages.experience import Chunk, Delivery, End, ExpertLabels
from common.messages.schema import decode, encode
from common.messages.validation import check_observations
from common.messages.weights import Weights
from common.observations.index import neighbour_table
from common.observations.observation import ObservationBatch
from common.system.runtime import python_module
from tests.observations import random_observation

STEPS = 16
VIEWPOINTS = 185
WEIGHTS_BYTES = 5_000_000
RUN = "bench"


def chunk(seed: int = 0, labels: bool = True) -> Chunk:
    """Make a chunk of 16 steps with 185 viewpoints each, the mean of the benchmark maps, and 12 neighbours for each."""
    rng = np.random.default_rng(seed)
    observations = [random_observation(rng, VIEWPOINTS, edge_share=0.52, bent_share=0.05) for _ in range(STEPS)]
    choices = [o.waypoint_nodes() for o in observations]
    expert = ExpertLabels(
        cost=np.zeros(sum(map(len, choices)), dtype=np.float32),
        beacon=np.full(STEPS, -1, dtype=np.int32),
        remaining=np.zeros(STEPS, dtype=np.float32),
        unseen=np.zeros(STEPS, dtype=np.float32),
    )
    return Chunk(
        episode=0,
        first_step=0,
        observations=ObservationBatch.stack(observations),
        beacons=np.array([o.beacon_nodes()[0] for o in observations], dtype=np.int32),
        waypoints=np.array([nodes[0] for nodes in choices], dtype=np.int32),
        rewards=np.zeros(STEPS, dtype=np.float32),
        versions=np.zeros(STEPS, dtype=np.int64),
        probabilities=np.ones(STEPS, dtype=np.float32),
        labels=expert if labels else None,
        end=End.NONE,
    )


def run(chunks: int = 1000, processes: Sequence[int] = (1, 4)) -> dict[str, float]:
    """Measure the codec alone, delivery from 1 and 4 processes, the acknowledgement and a pull of weights.

    Args:
        chunks: messages that each sending process delivers.
        processes: how many deliver at the same time, one measurement each.
    """
    results = _codec()
    config = BusConfig(listen=f"tcp/127.0.0.1:{free_port()}")
    with (
        open_learner_session(config) as session,
        ExperienceServer(session, RUN, new_incarnation(), lambda *_: 0.0),
        WeightsPublisher(session, RUN) as publisher,
    ):
        results |= latency(config, min(300, 20 + chunks))
        for count in processes:
            seconds, processor = deliver(config, count, chunks)
            results[f"deliver_chunks_per_s_{count}_processes"] = count * chunks / seconds
            results[f"receive_us_per_chunk_{count}_processes"] = 1e6 * processor / (count * chunks)
        results |= _weights(config, publisher)
    return results


def _codec() -> dict[str, float]:
    body = chunk()
    delivery = Delivery("bench-0", 1, 2, body)
    data = encode(delivery)
    observations = body.observations
    decode_s = _best(lambda: decode(data, Delivery))
    return {
        "chunk_bytes": len(data),
        "encode_us": 1e6 * _best(lambda: encode(delivery)),
        "decode_and_check_us": 1e6 * decode_s,
        "check_us_per_observation": 1e6 * _best(lambda: check_observations(observations, "o")) / STEPS,
        "neighbour_table_us_per_observation": 1e6 * _best(lambda: neighbour_table(observations)) / STEPS,
        "codec_chunks_per_s": 1 / decode_s,
    }


def latency(config: BusConfig, repeats: int = 300) -> dict[str, float]:
    """Measure the acknowledgement of one message after another, each sent when the one before has its own."""
    body = chunk()
    times = []
    with open_client_session(config) as session, ExperienceSender(session, RUN, "bench-latency") as sender:
        for _ in range(repeats):
            started = time.perf_counter()
            sender.send(body)
            sender.flush()
            times.append(time.perf_counter() - started)
    # The first ones connect and compile.
    median, late = np.percentile(times[20:], [50, 99])
    return {"ack_ms_p50": 1e3 * float(median), "ack_ms_p99": 1e3 * float(late)}


def deliver(config: BusConfig, processes: int, chunks: int) -> tuple[float, float]:
    """Return the seconds from the start signal until every sender has all its acknowledgements.

    And the processor seconds of this process, the receiving one, in that time: all its threads, those of Zenoh too.
    """
    senders = [
        subprocess.Popen(
            python_module("benchmarks.ingest", "send", config.listen, f"bench-{i}", str(chunks)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=child_environment(),
        )
        for i in range(processes)
    ]
    try:
        for sender in senders:
            _expect(sender, "ready")
        started, used = time.perf_counter(), time.process_time()
        for sender in senders:
            assert sender.stdin is not None
            sender.stdin.write("go\n")
            sender.stdin.flush()
        for sender in senders:
            _expect(sender, "done")
        return time.perf_counter() - started, time.process_time() - used
    finally:
        for sender in senders:
            sender.communicate()


def _expect(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdout is not None
    line = process.stdout.readline().strip()
    if line != word:
        raise RuntimeError(f"a sending process must say {word!r}, it said {line!r}: see its output above")


def _send(endpoint: str, actor: str, chunks: int) -> None:
    """Be one sending process."""
    body = chunk()
    config = BusConfig(listen=endpoint)
    with open_client_session(config) as session, ExperienceSender(session, RUN, actor) as sender:
        sender.send(body)
        sender.flush()
        print("ready", flush=True)
        sys.stdin.readline()
        for _ in range(chunks):
            sender.send(body)
        sender.flush()
        print("done", flush=True)


def _weights(config: BusConfig, publisher: WeightsPublisher, repeats: int = 20) -> dict[str, float]:
    """Measure from the call of publish until the checked tensors are in an actor's hands."""
    rng = np.random.default_rng(0)
    tensors = {f"layer{i}": rng.normal(size=WEIGHTS_BYTES // 400).astype(np.float32) for i in range(100)}
    times = []
    with open_client_session(config) as session, WeightsPuller(session, RUN) as puller:
        seen = None
        for version in range(repeats):
            started = time.perf_counter()
            publisher.publish(Weights.of(tensors, learner=1, version=version, updates=version))
            seen = puller.wait(10, after=seen)
            times.append(time.perf_counter() - started)
    return {"weights_5_mb_ms_p50": 1e3 * float(np.median(times)), "weights_5_mb_ms_min": 1e3 * min(times)}


def _best(function: Callable[[], object], repeats: int = 200) -> float:
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return min(times)


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main(arguments: Sequence[str]) -> None:
    """Print the figures, or be a sending process."""
    if arguments[:1] == ["send"]:
        _send(arguments[1], arguments[2], int(arguments[3]))
        return
    for name, value in run().items():
        print(f"{name:40s} {value:12.1f}")


if __name__ == "__main__":
    main(sys.argv[1:])
