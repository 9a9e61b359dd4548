"""Measure one decision of the policy at batch 1: features, graph, network, choice.

`python -m benchmarks.inference`: mean graph of 185 viewpoints and a large one of 400, both sizes, one thread, through
numpy, torch and (where onnx and onnxruntime are installed) ONNX Runtime. Times are processor
milliseconds of this thread, so that other work on the machine takes little part; run it with OMP_NUM_THREADS=1.
Targets: 2 ms at width 64 with 3 layers, 10 ms at width 128 with 6 layers.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from common.config import NetworkConfig
from common.network.factory import make_policy_network
from common.network.graph_arrays import GraphArrays
from common.network.graph_batch import GraphBatch
from common.network.onnx_network import OnnxNetwork
from common.network.parameters import initial_parameters
from common.observations.observation import Observation, ObservationBatch
from common.policies.policy import Policy
from learner.run.onnx_model import onnx_model
from tests.observations import random_observation

VIEWPOINTS = 185
LARGE = 400
SIZES = {
    "small": NetworkConfig(width=64, layers=3, heads=4),
    "paper": NetworkConfig(width=128, layers=6, heads=8),
}


def fastest(action: Callable[[], object], repeats: int) -> float:
    """Return the least processor seconds of this thread over some repeats, after one to warm up."""
    action()
    best = float("inf")
    for _ in range(repeats):
        start = time.thread_time()
        action()
        best = min(best, time.thread_time() - start)
    return best


def run(repeats: int = 200) -> dict[str, float]:
    """Return milliseconds of a decision for both sizes, of its graph part, and of the same through torch."""
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
