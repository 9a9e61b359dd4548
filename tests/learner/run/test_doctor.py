import dataclasses
import errno
import os

import numpy as np
import pytest
from typer.testing import CliRunner

from common.messages.schema import encode
from learner.cli import app
from learner.run.doctor import examine
from learner.run.event_file import PATTERN
from learner.run.folder import RunFolder
from learner.run.journal import Journal
from learner.run.records import RecordKind, segment_paths
from tests.learner.runs import episodes, make_trainer, small_config, train_some


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A run of 10 episodes with two checkpoints."""
    runs = tmp_path_factory.mktemp("runs")
    with RunFolder.create(runs, small_config()) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(10):
            trainer.ingest.store(delivery)
        train_some(trainer, 10)
        trainer.checkpoint()
        trainer.close()
    return run.path


@pytest.fixture
def run(sound, tmp_path):
    import shutil

    return shutil.copytree(sound, tmp_path / "runs" / "test")


def command(run, *options):
    return CliRunner().invoke(app, ["doctor", "--runs", str(run.parent), "--run", "test", *options])


def resumed(run):
    with RunFolder.open(run.parent, "test") as folder:
        trainer, _ = make_trainer(folder)
        trainer.resume()
        train_some(trainer, 2)
        trainer.close()
        return trainer


def test_a_sound_run_is_called_sound_and_left_alone(run):
    def content():
        return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "lock"}

    before = content()
    done = command(run, "--repair")
    assert done.exit_code == 0, done.output
    assert "checkpoints: 2 valid, the newest is 000000010" in done.output
    assert "journal: 30 valid records" not in done.output and "30 deliveries in them" in done.output
    assert content() == before


@pytest.mark.parametrize("value", [float("nan"), 3e38])
def test_poison_is_found_and_taken_out(run, value):
    poison = episodes(1, actor="liar-0")[0]
    body = dataclasses.replace(poison.body, rewards=np.full(4, value, dtype=np.float32))
    with Journal(run / "journal") as journal:
        journal.append(RecordKind.DELIVERY, encode(dataclasses.replace(poison, body=body)))
    assert resumed(run).ingest.poisoned == 1
    done = command(run)
    assert done.exit_code == 1
    assert "WRONG" in done.output and "no valid delivery" in done.output and "rewards" in done.output
    assert "hd-learner doctor --run test --repair" in done.output
    done = command(run, "--repair")
    assert done.exit_code == 0, done.output
    assert "set right" in done.output
    assert list((run / "damaged").iterdir())
    again = resumed(run)
    assert (again.ingest.poisoned, again.limiter.steps) == (0, 80)
    assert command(run).exit_code == 0


def test_everything_that_is_damaged_is_told_and_set_aside(run):
    flip(run / "checkpoints" / "000000000" / "tensors.safetensors", 1000)
    (run / "checkpoints" / "last").write_bytes(bytes(10))
    segment = max(segment_paths(run / "journal").values(), key=lambda path: path.stat().st_size)
    flip(segment, segment.stat().st_size // 2)
    flip(run / "episodes.jsonl", 3)
    (events,) = (run / "tensorboard").glob(PATTERN)
    flip(events, events.stat().st_size // 2)
    words = [
        "000000000 is damaged: tensors.safetensors",
        "checkpoints/last names no checkpoint",
        "bytes: record",
        "deliveries between others that are not in it: desk-0",
        "episodes.jsonl: 1 lines cannot be read: 1",
        f"tensorboard/{events.name}",
    ]
    for repair in (False, True):
        text = "\n".join(finding.text for finding in examine(run, repair=repair))
        for word in words:
            assert word in text
    assert all(not finding.wrong for finding in examine(run))
    assert len(list((run / "damaged").iterdir())) == 3
    assert (run / "checkpoints" / "damaged-000000000").is_dir()
    assert resumed(run).limiter.updates == 12


def flip(path, place):
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_a_run_in_work_is_not_touched(run):
    with RunFolder.open(run.parent, "test"):
        done = command(run)
    assert done.exit_code == 1 and "stop it first" in done.output


def test_who_only_looks_needs_no_permission_to_write(run, monkeypatch):
    def open_for_readers(path, flags, *rest, actual=os.open, **named):
        if str(path).startswith(str(run)) and flags & (os.O_RDWR | os.O_WRONLY | os.O_CREAT):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return actual(path, flags, *rest, **named)

    with RunFolder.open(run.parent, "test"), monkeypatch.context() as patch:
        patch.setattr(os, "open", open_for_readers)
        assert "stop it first" in command(run).output
    monkeypatch.setattr(os, "open", open_for_readers)
    assert (command(run).exit_code, command(run, "--repair").exit_code) == (0, 1)
    assert "cannot repair" in command(run, "--repair").output
    (run / "lock").unlink()
    assert command(run).exit_code == 0


def test_a_damaged_configuration_names_the_earlier_ones(run):
    (run / "config.7.json").write_text("{}")
    (run / "config.json").write_text("{")
    done = command(run, "--repair")
    assert done.exit_code == 1
    assert "config.json cannot be read" in done.output and "config.7.json" in done.output
