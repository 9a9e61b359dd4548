"""Trying one input on one decoder, within bounds on time and memory."""

from __future__ import annotations

import random
import resource
import tempfile
import time
from pathlib import Path

from benchmarks.faults.mutation import mutated
from tests.fuzz.targets import Target

SECONDS = 1.0
MEGABYTES = 200


def attempt(target: Target, data: bytes) -> str:
    """Return what is wrong with how a decoder takes some bytes; empty when nothing is.

    Time and memory are looked at again before they are called wrong: a busy machine is no defect.
    """
    problem = _attempt(target, data)
    return _attempt(target, data) if problem.startswith("took") else problem


def _attempt(target: Target, data: bytes) -> str:
    before = _peak_megabytes()
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        try:
            target.read(data, Path(folder))
        except target.refusals as error:
            if not str(error).strip() or len(str(error)) > 5000:
                return f"refused in {len(str(error))} characters"
        except Exception as error:  # noqa: BLE001  (whatever it is, it is what is looked for)
            return f"{type(error).__name__}: {error}"
    seconds, grown = time.process_time() - began, _peak_megabytes() - before
    if seconds > SECONDS:
        return f"took {seconds:.1f} s"
    return f"took {grown:.0f} MB" if grown > MEGABYTES else ""


def changed(target: Target, rng: random.Random) -> bytes:
    """Return a changed file of the corpus; some are two files spliced."""
    files = target.corpus()
    data = rng.choice(files).read_bytes()
    if rng.random() < 0.1:
        other = rng.choice(files).read_bytes()
        data = data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
    return mutated(data, rng)


def _peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
