"""Measure learner updates at batch 64 on real transitions, and the gain over a plain padded, dense implementation.

`python -m benchmarks.updates [--repeats N]`: for both sizes updates of soft actor-critic, proximal policy
optimisation and imitation, in fp32 and bfloat16, on the whole graph and on the reduced one; bfloat16 on the reduced
graph is how the shipped policies are trained. A processor without instructions for bfloat16 emulates it, which takes
longer than all other parts together, so there it is left out. Times are processor seconds of one thread, so that
other work on the machine takes little part; run it with OMP_NUM_THREADS=1 and the malloc settings of
`common.system.runtime`. The dense figures are forward and backward of the policy alone: the padded, masked fp32
implementation of the tests against ours on the same batch.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from benchmarks.experience import EPISODES, real_transitions
from benchmarks.inference import SIZES, fastest
from common.config import NetworkConfig, RunConfig
from common.network.factory import make_policy_network
from common.network.graph_batch import GraphBatch
from common.observations.observation import ObservationBatch
from learner.algorithm.device import cpu_has_bf16
from learner.algorithm.factory import make_learner
from tests.common.network.dense import dense_batch, dense_policy

BATCH = 64
# Name, arithmetic and graph.
WAYS = (
    ("fp32", "fp32", "full"),
    ("fp32_reduced", "fp32", "reduced"),
    ("bf16", "bf16", "full"),
    ("bf16_reduced", "bf16", "reduced"),
)


def run(
    repeats: int = 3,
    size: int = BATCH,
    episodes: int = EPISODES,
    networks: Sequence[str] = tuple(SIZES),
    ways: Sequence[tuple[str, str, str]] = WAYS,
) -> dict[str, float]:
    """Return viewpoints in the mean, updates per processor second, and the time of dense over ours.

    Args:
        repeats: of each update; the quickest counts.
        size: transitions of a batch.
        episodes: from which they are drawn.
        networks: names of sizes.
        ways: name, arithmetic and graph of each; bf16 is left out where the processor would emulate it.
    """
    torch.set_num_threads(1)
    batch = real_transitions(size, episodes)
    # As if a policy had drawn what the expert chose: on-policy returns count such steps alone.
    batch = replace(batch, probabilities=np.full(size, 0.5, dtype=np.float32))
    results: dict[str, float] = {"updates/viewpoints": float(batch.observations.count.mean())}
    for label in networks:
        network = SIZES[label]
        dense = _dense_seconds(network, batch.observations, repeats)
        for name, precision, graph in ways:
            if precision == "bf16" and not cpu_has_bf16():
                continue
            network_here = network.model_copy(update={"graph": graph})
            for stage, cloning in (("sac", 0), ("ppo", 0), ("cloning", 10_000)):
                config = RunConfig.model_validate(
                    {
                        "network": network_here.model_dump(),
                        "algorithm": "ppo" if stage == "ppo" else "sac",
                        "reward": {"kind": "potential"},
                        "cloning": {"updates": cloning},
                        "ppo": {"value_only_updates": 0},
                        "learner": {"precision": precision},
                    }
                )
                learner = make_learner(config, torch.device("cpu"))
                seconds = fastest(lambda learner=learner: learner.update(batch), repeats)  # type: ignore[misc]
                results[f"updates/{label}/{name}/{stage}_per_s"] = 1.0 / seconds
            ours = _our_seconds(network_here, precision == "bf16", batch.observations, repeats)
            results[f"updates/{label}/{name}/dense_over_ours"] = dense / ours
    return results


def _our_seconds(config: NetworkConfig, half: bool, observations: ObservationBatch, repeats: int) -> float:
    """Return the time of the policy's forward and backward pass, preparing the graphs not counted."""
    network = make_policy_network(config)
    graph = GraphBatch.from_observations(observations, config)

    def step() -> None:
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
            output = network(graph)
        (output.log_beacon.sum() + output.log_waypoint.sum()).backward()

    return fastest(step, repeats)


def _dense_seconds(config: NetworkConfig, observations: ObservationBatch, repeats: int) -> float:
    """Return the same in the dense form: every graph padded to the largest, attention over all pairs, masked."""
    network = make_policy_network(config)
    padded = dense_batch(observations, GraphBatch.from_observations(observations, config).features, vanilla=False)

    def step() -> None:
        log_beacon, log_waypoint = dense_policy(network, padded)
        (log_beacon.sum() + log_waypoint.sum()).backward()

    return fastest(step, repeats)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    for name, value in run(parser.parse_args().repeats).items():
        print(f"{name:45s} {value:10.3f}")
