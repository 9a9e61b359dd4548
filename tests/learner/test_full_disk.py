"""A disk that is full, wherever a learner writes: it holds, says so once, and continues when there is room."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from common.bus.experience import ExperienceSender
from common.bus.session import open_client_session
from common.config import BusConfig
from common.errors import StorageError
from learner.algorithm.factory import make_learner
from learner.loop import train
from learner.run import disk
from learner.run.folder import RunFolder
from learner.serial import SerialTrainer
from tests.learner.runs import episodes, make_trainer, small_config, train_some
from tests.rigs.disk import MountRefusedError, mounted
from tests.rigs.learner import Learner


@pytest.fixture
def small_disk(tmp_path, monkeypatch):
    """8 MB; probing for room is quick."""
    monkeypatch.setattr(disk, "_PROBE_SECONDS", 0.05)
    try:
        with mounted(tmp_path / "disk", 8) as disk_of_8_mb:
            yield disk_of_8_mb
    except MountRefusedError as error:
        pytest.skip(str(error))


@contextlib.contextmanager
def training(trainer):
    loop = threading.Thread(target=train, args=(trainer,))
    loop.start()
    try:
        yield
    finally:
        trainer.stop()
        loop.join(30.0)
        assert not loop.is_alive()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_learner_holds_and_goes_on(small_disk, caplog):
    caplog.set_level("INFO")
    made = episodes(40)
    with RunFolder.create(small_disk.path / "runs", small_config(checkpoints={"every_seconds": 0.2})) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in made[:30]:
            trainer.ingest.store(delivery)
        with training(trainer):
            until(lambda: trainer.limiter.updates >= 12)
            small_disk.fill()
            refused = store_what_fits(trainer, made[30:])
            assert refused
            until(lambda: trainer.state == "disk full")
            held = trainer.limiter.updates
            time.sleep(0.5)
            assert trainer.limiter.updates <= held + 1
            assert caplog.text.count("The learner pauses") == 1
            small_disk.empty()
            until(lambda: trainer.state != "disk full" and "there is space on the disk again" in caplog.text)
            assert caplog.text.count("there is space on the disk again") == 1
            for delivery in refused:
                trainer.ingest.store(delivery)
            until(lambda: trainer.limiter.updates > held + 5)
        trainer.close()
        assert "Traceback" not in caplog.text
        lines = run.episodes.read_text().splitlines()
        assert sorted(json.loads(line)["distance"] for line in lines) == [100.0 + i for i in range(40)]
        curves = EventAccumulator(str(run.tensorboard))
        curves.Reload()
        assert len(curves.Scalars("collect/steps")) >= trainer.limiter.updates // 10
    with RunFolder.open(small_disk.path / "runs", "test") as run:
        again, _ = make_trainer(run)
        again.resume()
        assert again.limiter.steps == 320 and again.ingest.episode_count == 40
        again.close()


def store_what_fits(trainer, deliveries):
    """Deliver as actors do; return what was refused."""
    refused = []
    for delivery in deliveries:
        try:
            trainer.ingest.store(delivery)
        except StorageError:
            refused.append(delivery)
    return refused


def test_a_checkpoint_without_room_leaves_the_one_before(small_disk, caplog):
    with RunFolder.create(small_disk.path / "runs", small_config()) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(4):
            trainer.ingest.store(delivery)
        train_some(trainer, 8)
        small_disk.fill(leave=100_000)
        with pytest.raises(StorageError, match=r"cannot write checkpoint .*make room"):
            trainer.checkpoint()
        assert trainer.checkpoints.names() == ["000000000"] and not trainer.checkpoints.damaged()
        trainer._checkpointer.schedule.request()
        for _ in range(5):
            trainer.serve()
        assert caplog.text.count("The learner pauses") == 1
        small_disk.empty()
        until(lambda: (trainer.serve(), trainer.checkpoints.names()[-1] == "000000008")[1])
        trainer.close()


def test_a_full_disk_refuses_a_new_run_and_leaves_nothing(small_disk):
    small_disk.fill()
    runs = small_disk.path / "runs"
    with pytest.raises(StorageError, match="make room"):
        RunFolder.create(runs, small_config())
    assert not runs.exists() or not list(runs.iterdir())
    small_disk.empty()
    RunFolder.create(runs, small_config()).close()


def test_a_first_checkpoint_waits_for_room(small_disk, caplog):
    with RunFolder.create(small_disk.path / "runs", small_config()) as run:
        small_disk.fill(leave=60_000)
        trainer, _ = make_trainer(run)
        beginning = threading.Thread(target=trainer.begin)
        beginning.start()
        until(lambda: trainer.disk.full)
        time.sleep(0.3)
        assert beginning.is_alive()
        assert caplog.text.count("The learner pauses") == 1
        small_disk.empty()
        beginning.join(20.0)
        assert trainer.checkpoints.names() == ["000000000"]
        trainer.close()


def test_a_run_that_a_full_disk_kept_from_its_first_checkpoint_begins_again(small_disk):
    with RunFolder.create(small_disk.path / "runs", small_config()) as run:
        small_disk.fill()
        with pytest.raises(StorageError):
            trainer, _ = make_trainer(run)
            trainer._open_records(0, 0)
            trainer.checkpoint()
        small_disk.empty()
    with RunFolder.create(small_disk.path / "runs", small_config(seed=9)) as run:
        again, _ = make_trainer(run)
        again.begin()
        assert run.config.seed == 9 and again.checkpoints.names() == ["000000000"]
        again.close()


def test_serial_mode_waits_for_room_with_what_it_collected(small_disk):
    made = episodes(30)
    with RunFolder.create(small_disk.path / "runs", small_config()) as run:
        trainer = SerialTrainer(run, make_learner(run.config, torch.device("cpu")))
        trainer.begin()
        small_disk.fill()
        collecting = threading.Thread(target=lambda: [trainer._deliver(delivery.body) for delivery in made])
        collecting.start()
        until(lambda: trainer.disk.full)
        assert trainer.limiter.steps < 240 and collecting.is_alive()
        small_disk.empty()
        collecting.join(20.0)
        assert (trainer.limiter.steps, trainer.ingest.episode_count) == (240, 30)
        trainer.close()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_command_says_it_in_one_line(small_disk):
    small_disk.fill()
    environment = {**os.environ, "TMPDIR": str(small_disk.path.parent)}
    command = [sys.executable, "-m", "learner", "start", "--run", "test", "--runs", str(small_disk.path / "runs")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, env=environment)
    assert done.returncode == 1
    assert "No space left on device; make room" in done.stderr
    assert "Traceback" not in done.stderr and len(done.stderr.splitlines()) <= 3


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_running_learner_holds_its_actors_and_loses_nothing(small_disk):
    learner = Learner(small_disk.path)
    learner.log = small_disk.path.parent / "log"
    made = episodes(60)
    try:
        with (
            open_client_session(BusConfig(), [learner.endpoint]) as session,
            ExperienceSender(session, "test", "desk-0", buffer=1000) as sender,
        ):
            learner.launch("start")
            for delivery in made[:90]:
                sender.send(delivery.body)
            assert sender.flush(100.0), learner.log.read_text()
            small_disk.fill()
            for delivery in made[90:]:
                sender.send(delivery.body)
            until(lambda: learner.status()["state"] == "disk full", 60.0)
            time.sleep(3.0)
            assert sender.pending
            small_disk.empty()
            assert sender.flush(60.0), learner.log.read_text()
            until(lambda: learner.status()["state"] != "disk full", 30.0)
            status = learner.status()
            assert (status["steps"], status["episodes"]) == (60 * 8, 60)
            learner.ask("stop")
            assert learner.process.wait(30.0) == 0
    finally:
        learner.end()
    log = learner.log.read_text()
    assert "Traceback" not in log and log.count("The learner pauses") == log.count("there is space on the disk again")
    assert len(log) < 20_000


def test_curves_lose_nothing_while_the_disk_is_full(small_disk):
    from learner.watch.metrics import Curves

    curves = Curves(small_disk.path / "curves")
    curves.write(1, {"a": 1.0})
    small_disk.fill()
    for update in range(2, 300):
        curves.write(update, {f"curve/{i}": 1.0 for i in range(20)})
    small_disk.empty()
    curves.write(300, {"a": 300.0})
    curves.close()
    read = EventAccumulator(str(small_disk.path / "curves"))
    read.Reload()
    assert [event.step for event in read.Scalars("a")] == [1, 300]
    assert [event.step for event in read.Scalars("curve/0")] == list(range(2, 300))
