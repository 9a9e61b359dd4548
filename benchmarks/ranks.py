"""Measure an update at batch 64 (width 64, fp32) that 1, 2 and 4 learner processes share, each with one thread.

`python -m benchmarks.ranks [--updates N]`: seconds of an update by the clock, and processor seconds of rank 0, its
share of the work and what the sharing costs it, which other work on the machine hardly changes. On fewer cores than
ranks the clock shows the sharing of cores instead.
"""

from __future__ import annotations

import argparse
import time

import torch

from benchmarks.experience import real_transitions
from benchmarks.inference import SIZES
from common.config import RunConfig
from learner.algorithm.factory import make_learner
from learner.ranks.messages import batch_fields, frame, state_fields
from learner.ranks.shards import split
from learner.ranks.team import open_learner

BATCH = 64
RANKS = (1, 2, 4)
CPU = torch.device("cpu")
WAIT_SECONDS = 180.0


def run(updates: int = 5) -> dict[str, float]:
    """Return seconds by the clock and of rank 0's processor for each number of ranks, and the bytes of messages."""
    torch.set_num_threads(1)
    batch = real_transitions(BATCH, episodes=4)
    config = RunConfig.model_validate(
        {"network": SIZES["small"].model_dump(), "reward": {"kind": "potential"}, "learner": {"precision": "fp32"}}
    )
    results: dict[str, float] = {"ranks/viewpoints": float(batch.observations.count.mean())}
    halves = split(batch, 2)
    results["ranks/half_batch_megabytes"] = len(frame("update", batch=batch_fields(halves[1]))) / 1e6
    learner = make_learner(config, CPU)
    learner.update(batch)
    results["ranks/state_megabytes"] = len(frame("state", **state_fields(*learner.state()))) / 1e6
    for ranks in RANKS:
        with open_learner(config, CPU, ranks, 1) as algorithm:
            end = time.monotonic() + WAIT_SECONDS
            while algorithm.update(batch).get("ranks/sharing", 1.0) < ranks:
                if time.monotonic() > end:
                    raise TimeoutError(f"{ranks} ranks did not come within {WAIT_SECONDS:.0f} s")
            clock, processor = [], []
            for _ in range(updates):
                began, used = time.perf_counter(), time.process_time()
                algorithm.update(batch)
                clock.append(time.perf_counter() - began)
                processor.append(time.process_time() - used)
        results[f"ranks/{ranks}/clock_ms"] = 1e3 * min(clock)
        results[f"ranks/{ranks}/processor_of_rank_0_ms"] = 1e3 * min(processor)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--updates", type=int, default=5)
    for name, value in run(parser.parse_args().updates).items():
        print(f"{name:45s} {value:10.3f}")
