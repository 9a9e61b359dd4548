"""Measure one decision of the policy at batch 1: features, graph, network, choice.

`python -m benchmarks.inference`: mean graph of 185 viewpoints and a large one of 400, both sizes, one thread, through
numpy, torch and (where onnx and onnxruntime are installed) ONNX Runtime; then by part in a hall that is known up to
some distance, with 500 to 3,000 viewpoints. Times are processor
milliseconds of this thread, so that other work on the machine takes little part; run it with OMP_NUM_THREADS=1.
Targets: 2 ms at width 64 with 3 layers, 10 ms at width 128 with 6 layers; 3 ms at 3,000 viewpoints.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import nn

from actors.maps.sources import open_sources
from common.config import MappingConfig, NetworkConfig
from common.geometry import Pose
from common.mapping.mapper import Mapper
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.onnx_network import OnnxNetwork
from common.network.parameters import initial_parameters
from common.observations.observation import Observation, ObservationBatch
from common.policies.policy import Policy
from common.policies.policy_file import read_weights
from common.policies.shipped import shipped_policy
from learner.run.onnx_model import onnx_model
from tests.observations import random_observation

VIEWPOINTS = 185
LARGE = 400
SIZES = {
    "small": NetworkConfig(width=64, layers=3, heads=4),
    "paper": NetworkConfig(width=128, layers=6, heads=8),
}
HALL = "generator:hall?seed=3&width=1280&height=1024"
RADII = {500: 61.0, 1200: 107.0, 3000: 200.0}
"""Metres around its start up to which the hall is known, by the number of viewpoints that this makes."""
TOKENS = NetworkConfig(width=64, layers=3, heads=4, features="guided", graph="tokens", toward=True)


def fastest(action: Callable[[], object], repeats: int) -> float:
    """Return the least processor seconds of this thread over some repeats, after one to warm up."""
    action()
    best = float("inf")
    for _ in range(repeats):
        start = time.thread_time()
        action()
        best = min(best, time.thread_time() - start)
    return best


def run(repeats: int = 200, large: Sequence[int] = tuple(RADII)) -> dict[str, float]:
    """Return milliseconds of a decision for both sizes, of its graph part, and of the same through torch.

    Args:
        repeats: of each measurement.
        large: numbers of viewpoints, of those in `RADII`, to measure `by_part` too.
    """
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    observation = random_observation(rng, VIEWPOINTS)
    results: dict[str, float] = {}
    for size, config in SIZES.items():
        policy, network = Policy.from_config(config), make_policy_network(config)

        def graph(config: NetworkConfig = config) -> GraphArrays:
            return GraphArrays.from_observations(ObservationBatch.stack([observation]), config)

        def decide(policy: Policy = policy) -> object:
            return policy.decide(observation, greedy=True, rng=rng)

        def through_torch(network: nn.Module = network, graph: Callable[[], GraphArrays] = graph) -> object:
            with torch.inference_mode():
                return network(GraphBatch.from_arrays(graph()))

        results[f"inference/{size}/decision_ms"] = 1e3 * fastest(decide, repeats)
        results[f"inference/{size}/graph_ms"] = 1e3 * fastest(graph, repeats)
        results[f"inference/{size}/torch_ms"] = 1e3 * fastest(through_torch, max(1, repeats // 4))
    for viewpoints in large:
        results |= by_part(viewpoints, repeats)
    return results


def known_hall(radius: float) -> Observation:
    """Return the observation at the start of a hall of which everything up to ``radius``, metres, is known."""
    world = open_sources([HALL], 0.25, "exploration").world(0)
    rows, columns = np.indices(world.free.shape)
    x = world.origin[0] + (columns + 0.5) * world.resolution - world.start[0]
    y = world.origin[1] + (rows + 0.5) * world.resolution - world.start[1]
    known = np.where(world.free, 0, 100)
    mapper = Mapper(MappingConfig(resolution=world.resolution), lattice_origin=world.lattice_origin)
    mapper.belief.assign(np.where(np.hypot(x, y) < radius, known, -1).astype(np.int8), world.origin)
    mapper.update(Pose(*world.start))
    return mapper.observe()


def by_part(viewpoints: int, repeats: int) -> dict[str, float]:
    """Return milliseconds of a decision in the known hall and of its parts, for the shipped network and for tokens."""
    observation, rng = known_hall(RADII[viewpoints]), np.random.default_rng(0)
    batch = ObservationBatch.stack([observation])
    arrays, card = read_weights(shipped_policy("exploration"))
    results: dict[str, float] = {}
    for name, config, weights in (
        ("shipped", card.network, arrays),
        ("tokens", TOKENS, initial_parameters(TOKENS, 0)),
    ):
        policy = Policy(config, weights)
        through_onnx = Policy.with_network(config, OnnxNetwork(onnx_model(config, weights)), 0)

        def graph(config: NetworkConfig = config) -> GraphArrays:
            return GraphArrays.from_observations(batch, config)

        def decide(policy: Policy) -> object:
            return policy.decide(observation, greedy=True, rng=rng)

        prefix = f"inference/{viewpoints}/{name}"
        results[f"{prefix}/nodes_read"] = len(graph().nodes)
        results[f"{prefix}/graph_ms"] = 1e3 * fastest(graph, repeats)
        results[f"{prefix}/decision_ms"] = 1e3 * fastest(partial(decide, policy), repeats)
        results[f"{prefix}/onnx_ms"] = 1e3 * fastest(partial(decide, through_onnx), repeats)
    return results


def run_engines() -> dict[str, float]:
    """Return milliseconds of a decision through numpy and through ONNX Runtime, for both sizes of graph and network."""
    rng = np.random.default_rng(0)
    observations = {viewpoints: random_observation(rng, viewpoints) for viewpoints in (VIEWPOINTS, LARGE)}
    results: dict[str, float] = {}
    for size, config in SIZES.items():
        arrays = initial_parameters(config, 0)
        engines = {
            "numpy": Policy(config, arrays),
            "onnx": Policy.with_network(config, OnnxNetwork(onnx_model(config, arrays)), 0),
        }
        for viewpoints, observation in observations.items():
            for engine, policy in engines.items():

                def decide(policy: Policy = policy, observation: Observation = observation) -> object:
                    return policy.decide(observation, greedy=True, rng=rng)

                results[f"inference/{size}/{viewpoints}/{engine}_ms"] = 1e3 * fastest(decide, 100)
    return results


if __name__ == "__main__":
    print(f"OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', 'not set')}")
    for name, value in (run() | run_engines()).items():
        print(f"{name:40s} {value:10.3f}")
