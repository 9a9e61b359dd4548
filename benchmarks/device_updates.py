"""Measure updates on a device such as a GPU: milliseconds of wall time at batch 192 on real transitions.

`python -m benchmarks.device_updates [--device cuda] [--batch N] [--compile]`: imitation and soft actor-critic, for both
sizes of network on the reduced graph, in fp32 and, where the device has it, bfloat16.
The batch is prepared beforehand, as a learner does in a thread of its own beside such a device; `prepare` is what that
takes on the host.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Sequence

import numpy as np
import torch

from benchmarks.experience import real_transitions
from benchmarks.inference import SIZES
from common.config import RunConfig
from learner.algorithm.device import choose_device, wants_bf16
from learner.algorithm.factory import make_learner

BATCH = 192
REPEATS = 10
EPISODES = 12


def run(
    device: str = "auto",
    size: int = BATCH,
    repeats: int = REPEATS,
    episodes: int = EPISODES,
    networks: Sequence[str] = tuple(SIZES),
    compiled: bool = False,
) -> dict[str, float]:
    """Return milliseconds by size, arithmetic and stage, the least of some repeats.

    Args:
        device: as `learner.device`.
        size: transitions of a batch.
        repeats: of each update.
        episodes: from which they are drawn.
        networks: names of sizes.
        compiled: measure with `learner.compile`, too.
    """
    where = choose_device(device)
    precisions = ("fp32", "bf16") if wants_bf16("auto", where) else ("fp32",)
    drawn = real_transitions(size, episodes)
    results: dict[str, float] = {"device_updates/viewpoints": float(drawn.observations.count.mean())}
    wholes = (False, True) if compiled else (False,)
    for label, precision, whole in itertools.product(networks, precisions, wholes):
        for stage, imitation in (("cloning", 1_000_000), ("sac", 0)):
            config = RunConfig.model_validate(
                {
                    "network": {**SIZES[label].model_dump(), "graph": "reduced"},
                    "reward": {"kind": "potential"},
                    "cloning": {"updates": imitation, "anchor_weight": 0.02},
                    "sac": {"privileged_critic": True, "n_step": 4, "critic_only_updates": 0},
                    "learner": {"precision": precision, "compile": whole},
                }
            )
            learner = make_learner(config, where)
            rng, cloning = np.random.default_rng(0), stage == "cloning"
            learner.prepare(drawn, rng, cloning=cloning)  # the first one loads its kernels
            began = time.perf_counter()
            batch = learner.prepare(drawn, rng, cloning=cloning)
            name = f"device_updates/{label}/{precision}{'/compiled' if whole else ''}/{stage}"
            results[f"{name}_prepare_ms"] = 1e3 * (time.perf_counter() - began)
            results[f"{name}_ms"] = 1e3 * _quickest(lambda run=learner, on=batch: run.update(on), where, repeats)  # type: ignore[misc]
    return results


def _quickest(update: Callable[[], object], device: torch.device, repeats: int) -> float:
    """Return the least wall seconds of an update that the device has finished, after two to warm up."""
    best = float("inf")
    for number in range(repeats + 2):
        start = time.perf_counter()
        update()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        if number >= 2:
            best = min(best, time.perf_counter() - start)
    return best


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="auto", help="auto, cpu, cuda or cuda:N (default: auto)")
    parser.add_argument("--batch", type=int, default=BATCH, help="transitions of a batch (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="of each update (default: %(default)s)")
    parser.add_argument("--compile", action="store_true", help="with learner.compile, too; minutes longer")
    options = parser.parse_args()
    for name, value in run(options.device, options.batch, options.repeats, compiled=options.compile).items():
        print(f"{name:50s} {value:10.3f}")


if __name__ == "__main__":
    main()
