"""Measure learner updates at batch 64 over graphs of 185 viewpoints on average, and the gain over padded networks.

`python -m benchmarks.updates [--repeats N]`: SAC and cloning updates for both sizes, one thread. Times are processor
seconds of this thread, so that other work on the machine takes little part; run it with OMP_NUM_THREADS=1 and the
malloc settings of `common.runtime`. The dense figure is forward and backward of the policy alone, ours against the
padded, masked implementation of the tests, on the same batch.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

from benchmarks.inference import SIZES, fastest
from common.config.schema import NetworkConfig, RunConfig
from common.network.graph_batch import GraphBatch
from common.network.policy_network import PolicyNetwork
from learner.algorithm.sac import SacLearner
from tests.common.network.dense import dense_batch, dense_policy
from tests.transitions import random_transitions

BATCH = 64
VIEWPOINTS = (80, 290)


def run(repeats: int = 3) -> dict[str, float]:
    """Return updates per processor second, and the time of dense over ours, for both sizes."""
    torch.set_num_threads(1)
    batch = random_transitions(np.random.default_rng(0), BATCH, VIEWPOINTS, ("none",), labelled=1.0)
    results: dict[str, float] = {}
    for size, network in SIZES.items():
        for stage, cloning in (("sac", 0), ("cloning", 10_000)):
            config = RunConfig.model_validate({"network": network.model_dump(), "cloning": {"updates": cloning}})
            learner = SacLearner(config, torch.device("cpu"))
            seconds = fastest(lambda learner=learner: learner.update(batch), repeats)  # type: ignore[misc]
            results[f"updates/{size}/{stage}_per_s"] = 1.0 / seconds
        results[f"updates/{size}/dense_over_ours"] = _dense_ratio(network, batch.observations, repeats)
    return results


def _dense_ratio(config: NetworkConfig, observations: object, repeats: int) -> float:
    """Return the time of the policy's forward and backward pass in the dense form over that in ours."""
    network = PolicyNetwork(config)
    graph = GraphBatch.from_observations(observations, config)  # type: ignore[arg-type]
    padded = dense_batch(observations, graph.features, vanilla=False)  # type: ignore[arg-type]

    def ours() -> None:
        output = network(graph)
        (output.log_beacon.sum() + output.log_waypoint.sum()).backward()

    def dense() -> None:
        log_beacon, log_waypoint = dense_policy(network, padded)
        (log_beacon.sum() + log_waypoint.sum()).backward()

    return fastest(dense, repeats) / fastest(ours, repeats)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    for name, value in run(parser.parse_args().repeats).items():
        print(f"{name:40s} {value:10.3f}")
