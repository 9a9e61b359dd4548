"""Curves that go to trackers too, and the table of runs."""

import csv
import io
import json
import logging

import pytest
from typer.testing import CliRunner

from learner.cli import app
from learner.run.folder import RunFolder
from learner.watch import writers
from learner.watch.writers import flat, make_writers
from tests.learner.runs import episodes, make_trainer, small_config, train_some

runner = CliRunner()


class Kept:
    """A tracker that keeps what it is given."""

    def __init__(self, folder, config) -> None:
        self.points: dict[int, dict[str, float]] = {}
        self.texts: dict[str, str] = {}
        self.figures: dict[str, object] = {}
        self.closed = False

    def write(self, update, values):
        self.points.setdefault(update, {}).update(values)

    def text(self, name, content):
        self.texts[name] = content

    def summary(self, values):
        self.figures = dict(values)

    def flush(self):
        pass

    def close(self):
        self.closed = True


class Broken(Kept):
    """A tracker whose server is away."""

    def write(self, update, values):
        raise ConnectionError("nobody is there")


def trained(tmp_path, **changes):
    """Train a small run to a checkpoint."""
    with RunFolder.create(tmp_path, small_config(**changes)) as run:
        trainer, _ = make_trainer(run)
        trainer.begin()
        for delivery in episodes(8):
            trainer.ingest.store(delivery)
        train_some(trainer, 20)
        trainer.checkpoint()
        trainer.close()
    return run


@pytest.fixture
def tracker(monkeypatch):
    """Return what takes the place of MLflow, once a run has begun."""
    made = []

    def make(folder, config):
        made.append(Kept(folder, config))
        return made[-1]

    monkeypatch.setattr(writers, "_MAKERS", {"mlflow": make, "wandb": Broken})
    return made


def test_a_tracker_gets_the_points_the_configuration_and_the_summary(tmp_path, tracker):
    trained(tmp_path, tracking={"writers": ["mlflow"]})
    (kept,) = tracker
    assert set(kept.points) == {10, 20}
    assert {"loss/critic", "collect/steps", "time/updates_per_second"} <= set(kept.points[20])
    assert '"name": "test"' in kept.texts["config"]
    assert kept.figures["updates"] == 20
    assert kept.closed


def test_a_tracker_that_fails_does_not_end_the_training(tmp_path, tracker, caplog):
    with caplog.at_level(logging.ERROR):
        run = trained(tmp_path, tracking={"writers": ["wandb", "mlflow"]})
    assert [record for record in caplog.records if "tracking by wandb failed" in record.message]
    assert json.loads((run.path / "summary.json").read_text("utf-8"))["updates"] == 20
    assert set(tracker[0].points) == {10, 20}


def test_a_tracker_that_is_not_installed_is_named_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setenv("HD_PROCESS_PREPARED", "1")
    monkeypatch.setitem(__import__("sys").modules, "mlflow", None)
    run = tmp_path / "runs"
    result = runner.invoke(
        app, ["start", "--serial", "--sim", "grid", "--runs", str(run), "--set", "tracking.writers=mlflow"]
    )
    assert result.exit_code == 1
    assert "tracking.writers=mlflow needs the package mlflow, which is not installed" in result.output
    assert not run.exists()


def test_mlflow_has_the_curves_and_a_resumed_run_goes_on_in_them(tmp_path):
    mlflow = pytest.importorskip("mlflow", reason="MLflow is not installed")
    run = trained(tmp_path, tracking={"writers": ["mlflow"], "project": "lab"})
    with RunFolder.open(tmp_path, "test") as again:
        trainer, _ = make_trainer(again)
        trainer.resume()
        train_some(trainer, 10)
        trainer.close()
    client = mlflow.MlflowClient(tracking_uri=f"sqlite:///{tmp_path}/mlflow.db")
    experiment = client.get_experiment_by_name("lab")
    (found,) = client.search_runs([experiment.experiment_id])
    assert found.info.run_name == "test"
    assert found.info.status == "FINISHED"
    assert found.data.params["learner.batch_size"] == "4"
    assert found.data.tags["summary.updates"] == "20"
    assert {point.step for point in client.get_metric_history(found.info.run_id, "loss/critic")} == {10, 20, 30}
    assert json.loads((run.path / "tracking.json").read_text("utf-8"))["mlflow"] == found.info.run_id


def test_weights_and_biases_writes_offline_into_the_run(tmp_path, monkeypatch):
    pytest.importorskip("wandb", reason="wandb is not installed")
    monkeypatch.delenv("WANDB_MODE", raising=False)
    run = trained(tmp_path, tracking={"writers": ["wandb"]})
    (written,) = (run.path / "wandb").glob("offline-run-*/*.wandb")
    assert b"loss/critic" in written.read_bytes()


def test_settings_have_their_dotted_names():
    settings = flat(small_config(maps={"train": ["generator:office"]}))
    assert settings["learner.updates_per_step"] == "1.0"
    assert settings["maps.train"] == '["generator:office"]'
    assert settings["name"] == "test"


def test_no_tracker_is_made_unless_it_is_named(tmp_path):
    assert make_writers(tmp_path, small_config()) == []
    assert list(tmp_path.iterdir()) == []


def test_runs_are_compared_in_a_table(tmp_path):
    trained(tmp_path)
    trained(tmp_path, name="other", seed=7)
    result = runner.invoke(app, ["runs", "--runs", str(tmp_path)])
    assert result.exit_code == 0, result.output
    lines = [line.split() for line in result.output.splitlines()]
    assert [line[0] for line in lines] == ["run", "other", "test"]
    assert "20 of 1,000" in result.output
    table = runner.invoke(app, ["runs", "--runs", str(tmp_path), "--format", "csv"]).output
    rows = list(csv.DictReader(io.StringIO(table)))
    assert [(row["name"], row["seed"], row["updates"]) for row in rows] == [("other", "7", "20"), ("test", "5", "20")]
    values = json.loads(runner.invoke(app, ["runs", "--runs", str(tmp_path), "--format", "json"]).output)
    assert values[1]["total_updates"] == 1000


def test_a_damaged_summary_does_not_hide_the_other_runs(tmp_path):
    trained(tmp_path)
    whole = json.loads((tmp_path / "test" / "summary.json").read_text())
    damaged = {
        "cut": '{"name": "cut"',
        "words": json.dumps({**whole, "updates": "many"}),
        "half": json.dumps({**whole, "best": {"success": 1.0}}),
        "later": json.dumps({**whole, "name": "later", "new": 1}),
    }
    for name, text in damaged.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(text)
    for style in ("text", "csv", "json"):
        result = runner.invoke(app, ["runs", "--runs", str(tmp_path), "--format", style])
        assert result.exit_code == 1
        assert "3 runs are left out" in result.stderr
        assert "words/summary.json cannot be read (updates: " in result.stderr
        assert "later" in result.stdout and "test" in result.stdout


def test_a_folder_without_runs_says_so(tmp_path):
    result = runner.invoke(app, ["runs", "--runs", str(tmp_path)])
    assert result.exit_code == 1
    assert "there is no run with a summary.json" in result.output
