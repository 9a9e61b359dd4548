"""A run continues from object storage on a machine that has nothing but its URL."""

import logging
import shutil
import threading

import numpy as np
import pytest

from common.errors import CheckpointError, ConfigError
from common.system.remote_files import RemoteError, RemoteFolder
from learner.run import mirror
from learner.run.folder import RunFolder
from learner.run.mirror import fetch_run
from tests.common.bus.processes import eventually
from tests.learner.runs import episodes, make_trainer, small_config

pytest.importorskip("fsspec")


@pytest.fixture
def s3():
    """A bucket of moto's server."""
    moto = pytest.importorskip("moto.server")
    s3fs = pytest.importorskip("s3fs")
    server = moto.ThreadedMotoServer(port=0)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        s3fs.S3FileSystem(skip_instance_cache=True).mkdir("bucket")
        yield "s3://bucket/runs"
    server.stop()


@pytest.fixture(params=["file", pytest.param("s3", marks=pytest.mark.slow)])
def url(request, tmp_path):
    return f"file://{tmp_path}/elsewhere" if request.param == "file" else request.getfixturevalue("s3")


def train(trainer, deliveries, updates):
    for delivery in deliveries:
        trainer.ingest.store(delivery)
    for _ in range(updates):
        assert trainer.learn(trainer.sample())
    trainer.checkpoint()


def test_a_run_goes_on_on_another_machine_and_after_a_second_death_there(url, tmp_path, caplog):
    config = small_config(checkpoints={"mirror": url, "keep": 2})
    made = episodes(8)
    here, there = tmp_path / "here", tmp_path / "there"
    with RunFolder.create(here, config) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for part in range(3):
            train(trainer, made[part * 6 : part * 6 + 6], 3)
        wanted, _ = trainer.algorithm.state()
        counts = trainer.limiter.steps, trainer.limiter.updates, trainer.ingest.episode_count
        trainer.close()
    shutil.rmtree(here)
    remote = RemoteFolder(f"{url}/test")
    assert [name for name in remote.names("checkpoints") if name.isdigit()] == ["000000006", "000000009"]

    fetch_run(url, there, "test")
    with RunFolder.open(there, "test") as run:
        trainer, _ = make_trainer(run)
        trainer.resume()
        found, _ = trainer.algorithm.state()
        assert all(np.array_equal(found[name], value) for name, value in wanted.items())
        assert (trainer.limiter.steps, trainer.limiter.updates, trainer.ingest.episode_count) == counts
        # What was counted before is not counted again; what is new is kept, although no checkpoint follows.
        for delivery in made:
            trainer.ingest.store(delivery)
        trainer._journal.sync()
        steps = trainer.limiter.steps
        assert steps == 8 * 8
        trainer._mirror.close()
    with RunFolder.open(there, "test") as run:
        trainer, _ = make_trainer(run)
        trainer.resume()
        assert trainer.limiter.steps == steps
        trainer.close()
    with pytest.raises(CheckpointError, match="here already"):
        fetch_run(url, there, "test")
    assert "damaged" not in caplog.text


def test_training_goes_on_while_the_storage_is_away(tmp_path, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(mirror, "RETRY_SECONDS", 0.05)
    away = [True]
    put = RemoteFolder.put

    def refuse(self, file, name):
        if away[0]:
            raise RemoteError("no route to the bucket")
        put(self, file, name)

    monkeypatch.setattr(RemoteFolder, "put", refuse)
    url = f"file://{tmp_path}/elsewhere"
    with RunFolder.create(tmp_path / "runs", small_config(checkpoints={"mirror": url})) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        train(trainer, episodes(2), 2)
        assert eventually(lambda: "no route to the bucket" in caplog.text)
        away[0] = False
        assert eventually(lambda: "000000002" in RemoteFolder(f"{url}/test").names("checkpoints"))
        trainer.close()
    assert caplog.text.count("no route to the bucket") == 1


def test_a_checkpoint_that_is_written_while_another_is_on_its_way_arrives_before_the_end(tmp_path, monkeypatch):
    on_its_way, last_written = threading.Event(), threading.Event()
    put = RemoteFolder.put

    def slow(self, file, name):
        put(self, file, name)
        if name == "checkpoints/000000001/manifest.json":
            on_its_way.set()
            last_written.wait(30.0)

    monkeypatch.setattr(RemoteFolder, "put", slow)
    url = f"file://{tmp_path}/elsewhere"
    with RunFolder.create(tmp_path / "runs", small_config(checkpoints={"mirror": url})) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        made = episodes(2)
        train(trainer, made[:6], 1)
        assert on_its_way.wait(30.0)
        train(trainer, made[6:], 1)
        threading.Timer(0.2, last_written.set).start()
        trainer.close()
    assert "000000002" in RemoteFolder(f"{url}/test").names("checkpoints")


def test_what_cannot_be_fetched_is_said_in_one_line_and_leaves_nothing(tmp_path):
    with pytest.raises(CheckpointError, match="no run 'test' with a checkpoint"):
        fetch_run(f"file://{tmp_path}/nowhere", tmp_path / "runs", "test")
    assert list((tmp_path / "runs").iterdir()) == []
    for wrong in ("bucket/runs", "nonsense://bucket"):
        with pytest.raises(ConfigError, match="s3"):
            RemoteFolder(wrong)
