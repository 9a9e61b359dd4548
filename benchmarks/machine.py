"""Measure the machine itself, by work that has nothing of this project in it: what other figures can be held against.

The same virtual machine may be twice as fast in one hour as in another, whatever its load says. Where these figures
differ between two runs by as much as others do, the code has not changed.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

_ADDITIONS = 1_000_000
_SIDE = 512
_BYTES = 64 << 20


def run(repeats: int = 20) -> dict[str, float]:
    """Return the least of several times of an interpreter's loop, and the most of bytes and operations a second."""
    import torch

    source = np.ones(_BYTES, dtype=np.uint8)
    target = np.empty_like(source)
    matrix = torch.ones(_SIDE, _SIDE)
    loops, copies, products = [], [], []
    for _ in range(repeats):
        clock = [perf_counter()]
        total = 0
        for number in range(_ADDITIONS):
            total += number
        clock.append(perf_counter())
        np.copyto(target, source)
        clock.append(perf_counter())
        torch.mm(matrix, matrix)
        clock.append(perf_counter())
        for times, seconds in zip((loops, copies, products), np.diff(clock).tolist(), strict=True):
            times.append(seconds)
    return {
        "machine/python_additions_per_us": _ADDITIONS / min(loops) / 1e6,
        "machine/copied_gb_per_s": _BYTES / min(copies) / 1e9,
        "machine/fp32_gflops_one_core": 2.0 * _SIDE**3 / min(products) / 1e9,
    }
