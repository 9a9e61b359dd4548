"""Try decoders with changed bytes: ``make fuzz MINUTES=10``, or ``python -m tests.fuzz [TARGET ...]``.

What fails is kept in `tests/fuzz/found/`; once it is mended, move it into the corpus.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import random
import sys
import time
from pathlib import Path

from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.trying import attempt, changed

FOUND = Path(__file__).with_name("found")


def fuzz(target: Target, seconds: float, rng: random.Random) -> tuple[int, dict[str, bytes]]:
    """Try one decoder for some seconds; return the number of inputs, and one of them for each failure."""
    tried, failures = 0, {}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        data = changed(target, rng)
        problem = attempt(target, data)
        tried += 1
        if problem:
            failures.setdefault(problem.split(":")[0], data)
            print(f"  {target.name}: {problem[:300]}", flush=True)
    return tried, failures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; default all")
    parser.add_argument("--minutes", type=float, default=10.0, help="of all together (default 10)")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="default: another each time")
    chosen = parser.parse_args()
    unknown = set(chosen.targets) - set(TARGETS)
    if unknown:
        parser.error(f"unknown target {sorted(unknown)[0]!r}: choose from {', '.join(TARGETS)}")
    logging.disable(logging.CRITICAL)
    names = chosen.targets or list(TARGETS)
    failed = False
    for name in names:
        tried, failures = fuzz(TARGETS[name], 60.0 * chosen.minutes / len(names), random.Random(chosen.seed))
        print(f"{name}: {tried:,} inputs, {len(failures)} kinds of failure, seed {chosen.seed}", flush=True)
        for data in failures.values():
            failed = True
            (FOUND / name).mkdir(parents=True, exist_ok=True)
            (FOUND / name / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
