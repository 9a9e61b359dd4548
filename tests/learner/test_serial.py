"""Serial mode: the whole system in one process, exact by seed."""

import io
import json
import signal

import pytest
from rich.console import Console
from safetensors.numpy import load_file

from common.config import load_config
from learner.run.folder import RunFolder
from learner.serial import run_serial

SMALL = [
    "maps.train=generator:rooms?width=256&height=192",
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "simulator.name=grid",
    "mapping.resolution=0.5",
    "task.max_steps=24",
    "reward.kind=potential",
    "cloning.updates=3",
    "replay.min_steps=40",
    "learner.batch_size=8",
    "learner.updates_per_step=0.25",
    "learner.publish_every=2",
    "learner.threads=1",
    "sac.critic_only_updates=2",
]


def train(folder, name, *extra, resume=False):
    config = load_config(overrides=[*SMALL, f"name={name}", *extra])
    opened = RunFolder.open(folder, name) if resume else RunFolder.create(folder, config)
    with opened as run:
        if resume:
            run.reconfigure(config)
        run_serial(run, Console(file=io.StringIO()), resume=resume)
    last = (folder / name / "checkpoints" / "last").read_text().strip()
    checkpoint = folder / name / "checkpoints" / last
    tensors = {}
    for file in sorted(checkpoint.glob("*.safetensors")):
        tensors |= load_file(file)
    return tensors, [json.loads(line) for line in (folder / name / "episodes.jsonl").read_text().splitlines()]


def same(one, other):
    return one.keys() == other.keys() and all((one[key] == other[key]).all() for key in one)


@pytest.mark.timeout(300)
def test_the_seed_alone_decides_the_weights(tmp_path):
    first, episodes = train(tmp_path, "one", "learner.total_updates=10")
    second, again = train(tmp_path, "two", "learner.total_updates=10")
    other, _ = train(tmp_path, "three", "learner.total_updates=10", "seed=1")
    assert same(first, second)
    assert not same(first, other)
    route = [(episode["map_name"], episode["distance"], episode["driver"]) for episode in episodes]
    assert route == [(episode["map_name"], episode["distance"], episode["driver"]) for episode in again]
    assert {episode["driver"] for episode in episodes} <= {"policy", "expert"}


def test_kernels_are_compiled_while_a_signal_still_ends_the_process(tmp_path, monkeypatch):
    before, heard = signal.getsignal(signal.SIGTERM), []

    def compiling(network):
        heard.append(signal.getsignal(signal.SIGTERM))
        raise KeyboardInterrupt

    monkeypatch.setattr("learner.serial.compile_kernels", compiling)
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path, "cold")
    assert heard == [before]


@pytest.mark.timeout(300)
def test_a_run_goes_on_where_it_ended(tmp_path):
    _, before = train(tmp_path, "run", "learner.total_updates=6")
    tensors, after = train(tmp_path, "run", "learner.total_updates=9", resume=True)
    assert after[: len(before)] == before
    assert len(after) >= len(before)
    assert tensors
    last = tmp_path / "run" / "checkpoints" / (tmp_path / "run" / "checkpoints" / "last").read_text().strip()
    documents = [json.loads(file.read_text()) for file in last.glob("*.json")]
    assert any(document.get("updates") == 9 for document in documents)
