import json
import os
import subprocess
import sys

import pytest
import torch

from common.config import LearnerConfig, RunConfig
from common.errors import CheckpointError
from learner.run.checkpoints import CheckpointStore
from learner.run.disk import DiskWatch
from learner.run.event_file import EventFile
from learner.run.folder import RunFolder, check_run
from learner.run.journal import Journal


def test_a_new_run_is_complete_and_comes_back(tmp_path):
    config = RunConfig(name="office-1", seed=3)
    with RunFolder.create(tmp_path, config) as run:
        assert run.path == tmp_path / "office-1"
        code = json.loads((run.path / "code.json").read_text())
        assert "commit" in code["git"] or "absent" in code["git"]
        assert code["packages"]["torch"]
    with RunFolder.open(tmp_path, "office-1") as run:
        assert run.config == config


def test_a_group_shares_a_run_as_far_as_the_umask_lets_it(tmp_path):
    umask = os.umask(0o002)
    try:
        with RunFolder.create(tmp_path, RunConfig(name="a")) as run:
            disk = DiskWatch(run.path)
            CheckpointStore(run.checkpoints, keep=1).save(0, {"a": torch.zeros(2)}, {})
            Journal(run.journal).close()
            EventFile(run.tensorboard, disk).close()
    finally:
        os.umask(umask)
    files = [path for path in run.path.rglob("*") if path.is_file()]
    assert len(files) >= 8
    assert {path.name: oct(path.stat().st_mode & 0o777) for path in files if path.stat().st_mode & 0o777 != 0o664} == {}


def test_a_run_is_never_overwritten_without_being_told(tmp_path):
    config = RunConfig(name="a")
    with RunFolder.create(tmp_path, config) as run:
        (run.path / "episodes.jsonl").write_text("precious\n")
        (run.checkpoints / "000000000").mkdir(parents=True)
    with pytest.raises(CheckpointError, match=r"exists already.*resume --run a.*--overwrite"):
        RunFolder.create(tmp_path, config)
    assert (tmp_path / "a" / "episodes.jsonl").read_text() == "precious\n"
    with RunFolder.create(tmp_path, config, overwrite=True) as run:
        assert not run.episodes.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_run_without_a_checkpoint_begins_again_with_its_journal(tmp_path):
    with RunFolder.create(tmp_path, RunConfig(name="a", seed=1)) as run:
        run.journal.mkdir()
        (run.journal / "precious").write_text("records")
    with RunFolder.create(tmp_path, RunConfig(name="a", seed=2)) as run:
        assert run.config.seed == 2
        assert (run.journal / "precious").exists()
        assert json.loads((run.path / "config.1.json").read_text())["seed"] == 1
        run.checkpoints.mkdir()
        (run.checkpoints / "damaged-000000000").mkdir()
    with pytest.raises(CheckpointError, match="exists already"):
        RunFolder.create(tmp_path, RunConfig(name="a"))


def test_what_killed_starts_left_is_cleared(tmp_path):
    left = tmp_path / ".a.4194305.tmp"  # beyond the largest process number of Linux
    left.mkdir()
    other = tmp_path / f".a.{os.getppid()}.tmp"
    other.mkdir()
    RunFolder.create(tmp_path, RunConfig(name="a")).close()
    assert not left.exists() and other.exists()


def test_a_run_of_format_3_is_continued_and_marked(tmp_path):
    with RunFolder.create(tmp_path, RunConfig(name="a")) as run:
        marker = json.loads((run.path / "run.json").read_text())
        (run.path / "run.json").write_text(json.dumps(marker | {"format": 3}))
    RunFolder.open(tmp_path, "a").close()
    assert json.loads((tmp_path / "a" / "run.json").read_text()) == marker | {"format": 4}


def test_overwriting_never_deletes_what_is_no_run(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "thesis.tex").write_text("precious")
    with pytest.raises(CheckpointError, match="not the folder of a run"):
        RunFolder.create(tmp_path, RunConfig(name="a"), overwrite=True)
    assert (tmp_path / "a" / "thesis.tex").exists()


def test_two_learners_cannot_work_on_one_run(tmp_path):
    with RunFolder.create(tmp_path, RunConfig(name="a")):
        for attempt in (
            lambda: RunFolder.open(tmp_path, "a"),
            lambda: RunFolder.create(tmp_path, RunConfig(name="a"), overwrite=True),
        ):
            with pytest.raises(CheckpointError, match=r"a learner \(process \d+\) works on the run.*stop it first"):
                attempt()
    RunFolder.open(tmp_path, "a").close()


def test_the_lock_dies_with_its_process(tmp_path):
    program = (
        "import os, sys; from pathlib import Path; from common.config import RunConfig; "
        "from learner.run.folder import RunFolder; "
        "run = RunFolder.create(Path(sys.argv[1]), RunConfig(name='a')); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path)]).returncode == -9
    RunFolder.open(tmp_path, "a").close()


def test_an_unknown_run_names_those_that_exist(tmp_path):
    with pytest.raises(CheckpointError, match="there is no run 'b'.*there are none yet"):
        RunFolder.open(tmp_path, "b")
    RunFolder.create(tmp_path, RunConfig(name="a")).close()
    with pytest.raises(CheckpointError, match="no run 'b'.*there are: a"):
        RunFolder.open(tmp_path, "b")


def test_a_changed_configuration_keeps_the_one_before(tmp_path):
    config = RunConfig(name="a")
    with RunFolder.create(tmp_path, config) as run:
        changed = config.model_copy(update={"learner": LearnerConfig(total_updates=5)})
        run.reconfigure(config)
        run.write_config()
        assert not list(run.path.glob("config.*.json"))
        run.reconfigure(changed)
        run.write_config()
        before = json.loads((run.path / "config.1.json").read_text())
        assert before["learner"]["total_updates"] == 20_000
    with RunFolder.open(tmp_path, "a") as run:
        assert run.config.learner.total_updates == 5


@pytest.mark.parametrize("written", [1, 2])
def test_a_run_of_an_earlier_format_can_be_exported_but_not_continued(tmp_path, written):
    with RunFolder.create(tmp_path, RunConfig(name="a")) as run:
        marker = json.loads((run.path / "run.json").read_text())
        (run.path / "run.json").write_text(json.dumps(marker | {"format": written}))
    check_run(tmp_path / "a")
    advice = rf"format {written}, .*cannot read experience.*export --run a.*learner\.initial_policy"
    with pytest.raises(CheckpointError, match=advice):
        check_run(tmp_path / "a", to_continue=True)
    with pytest.raises(CheckpointError, match=advice):
        RunFolder.open(tmp_path, "a")


@pytest.mark.parametrize("written", [0, 5, "1", None])
def test_a_run_of_an_unknown_format_is_refused(tmp_path, written):
    RunFolder.create(tmp_path, RunConfig(name="a")).close()
    (tmp_path / "a" / "run.json").write_text(json.dumps({"format": written}))
    with pytest.raises(CheckpointError, match="this software reads format 4 and earlier ones"):
        check_run(tmp_path / "a")


def test_a_configuration_of_another_release_is_named(tmp_path):
    RunFolder.create(tmp_path, RunConfig(name="a")).close()
    file = tmp_path / "a" / "config.json"
    values = json.loads(file.read_text())
    values["learner"]["novel"] = 1
    file.write_text(json.dumps(values))
    with pytest.raises(
        CheckpointError, match="config.json does not suit this release: .*learner.novel: unknown"
    ) as caught:
        RunFolder.open(tmp_path, "a")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["run.json", "config.json"])
def test_documents_that_nest_without_end_are_damaged_ones(tmp_path, name):
    with RunFolder.create(tmp_path, RunConfig(name="a")) as run:
        pass
    (run.path / name).write_text("[" * 100_000)
    with pytest.raises(CheckpointError, match=rf"{name}.*must not nest deeper"):
        RunFolder.open(tmp_path, "a")
