import os
import time

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from learner.run import event_file
from learner.run.event_file import PATTERN, mend_events
from learner.run.folder import RunFolder
from learner.watch.metrics import Curves
from tests.learner.runs import episodes, make_trainer, small_config, train_some


def curves(folder, points=20):
    written = Curves(folder)
    written.text("config", "the configuration")
    for update in range(points):
        written.write(update, {"loss": float(update)})
    written.close()
    (file,) = folder.glob(PATTERN)
    return file


def steps(folder):
    read = EventAccumulator(str(folder))
    read.Reload()
    return [event.step for event in read.Scalars("loss")]


def test_tensorboard_reads_scalars_and_texts(tmp_path):
    curves(tmp_path)
    read = EventAccumulator(str(tmp_path))
    read.Reload()
    assert [(event.step, event.value) for event in read.Scalars("loss")] == [(i, float(i)) for i in range(20)]
    assert read.Tensors("config/text_summary")[0].tensor_proto.string_val == [b"the configuration"]


def test_flushed_points_survive_a_power_failure(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(event_file, "sync_descriptor", lambda descriptor: synced.append(os.fstat(descriptor).st_size))
    written = Curves(tmp_path)
    written.write(1, {"loss": 1.0})
    assert synced == []
    written.flush()
    (file,) = tmp_path.glob(PATTERN)
    assert synced == [file.stat().st_size]
    written.close()


@pytest.mark.parametrize("damage", ["bit", "zeros", "torn"])
def test_damage_in_the_middle_hides_nothing_behind_it(tmp_path, damage):
    folder = tmp_path / "tensorboard"
    file = curves(folder)
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    if damage == "bit":
        content[middle] ^= 4
    elif damage == "zeros":
        content[middle : middle + 100] = bytes(100)
    else:
        del content[-5:]
    file.write_bytes(content)
    before = steps(folder)
    lost = mend_events(file, tmp_path / "damaged", dry=True)
    assert 0 < lost < 200 and file.read_bytes() == content
    assert mend_events(file, tmp_path / "damaged") == lost
    after = steps(folder)
    assert len(after) >= 16 and set(after) >= set(before)
    if damage != "torn":
        assert after[-1] == 19 > before[-1]
    assert sum(kept.stat().st_size for kept in (tmp_path / "damaged").iterdir()) == lost
    assert mend_events(file, tmp_path / "damaged") == 0


def test_a_resumed_run_shows_the_points_behind_damage(tmp_path, caplog):
    with RunFolder.create(tmp_path, small_config()) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(8):
            trainer.ingest.store(delivery)
        train_some(trainer, 20)
        trainer.checkpoint()
        trainer.close()
        (file,) = run.tensorboard.glob(PATTERN)
        whole = [event.step for event in points(run.tensorboard)]
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    with RunFolder.open(tmp_path, "test") as run:
        trainer, _ = make_trainer(run)
        trainer.resume()
        trainer.close()
        assert len(points(run.tensorboard)) >= len(whole) - 1
        assert points(run.tensorboard)[-1].step == whole[-1]
        assert "damaged bytes hid the points behind them" in caplog.text
        assert any((run.path / "damaged").iterdir())


def points(folder):
    read = EventAccumulator(str(folder))
    read.Reload()
    return read.Scalars("collect/steps")


def test_a_run_goes_on_behind_its_curves_after_the_clock_was_set_back(tmp_path, monkeypatch):
    with Curves(tmp_path) as written:
        written.write(1, {"loss": 1.0})
        written.write(2, {"loss": 2.0})
    earlier = time.time() - 3600.0
    monkeypatch.setattr(event_file.time, "time", lambda: earlier)
    with Curves(tmp_path, update=1) as written:
        written.write(2, {"loss": 20.0})
    read = EventAccumulator(str(tmp_path))
    read.Reload()
    assert [(event.step, event.value) for event in read.Scalars("loss")] == [(1, 1.0), (2, 20.0)]
