"""Every part of the benchmarks in its short form: a part that measures nothing any more is found here."""

import importlib
import importlib.util
import math

import pytest
import torch

from benchmarks.__main__ import PARTS
from tests.actors.maps.images import paint

# The processes that these start take half a minute, however little they do.
SLOW = {"acknowledgement", "page"}
SHORT = [
    pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
    for name, part in PARTS.items()
    if part.short is not None
]


@pytest.fixture(autouse=True)
def threads():
    """Some parts measure on one thread, and need no way back in a process of their own."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize("name", SHORT)
def test_a_part_measures(name, tmp_path, monkeypatch):
    if name in ("simulators", "actor_steps") and importlib.util.find_spec("pybullet") is None:
        pytest.skip("PyBullet is not installed")
    monkeypatch.chdir(tmp_path)
    arguments = dict(PARTS[name].short)
    if name == "large_plan":
        # The real one is not part of the repository.
        arguments["plan"] = paint(tmp_path / "plan.png", [(4, 4, 92, 60)], [((20, 20, 24, 24), (255, 255, 0))])
    figures = importlib.import_module(f"benchmarks.{name}").run(**arguments)
    assert figures
    assert all(math.isfinite(value) for value in figures.values())
    assert sum(value > 0.0 for value in figures.values()) > 0.8 * len(figures)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_memory_of_each_process_is_measured():
    figures = importlib.import_module("benchmarks.memory").run(updates=1)
    assert {"learner MB", "actor 0 MB", "actor 1 MB", "supervisor of the actors MB"} <= figures.keys()
    assert figures["updates made"] >= 1.0
