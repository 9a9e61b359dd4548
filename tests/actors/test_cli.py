import pytest
from typer.testing import CliRunner

from actors.cli import app, free_names
from actors.options import ActorOptions, host_name
from common.config import BusConfig, RunConfig
from common.ids import check_id
from tests.actors.learner_end import LearnerEnd, free_port


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--gui", "--num", "2"], "--num 1"),
        (["--gui", "--sim", "grid"], "pybullet"),
        (["--gui", "--launcher", "ray"], "--launcher local"),
        (["--ray-address", "10.0.0.5:6379"], "--launcher ray"),
        (["--name", "Not a name"], "lower-case"),
        (["--name", 64 * "a", "--run", "r"], "lower-case"),
        (["--metrics", "65535", "--num", "3"], "ports up to 65537"),
        (["--tls-ca", "ca.pem"], "all three"),
        (["--connect", "nowhere"], "tcp/HOST:PORT"),
        (["--connect", f"tcp/127.0.0.1:{free_port()}"], "hd-learner start"),
    ],
)
def test_bad_options_are_one_clear_line(arguments, word):
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert word in result.output
    assert "Traceback" not in result.output


def test_help_shows_examples():
    result = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert "hd-actor --num 8" in result.output


def test_names_skip_those_that_are_there():
    assert free_names("desk", 3, frozenset({"desk-0", "desk-2", "other-1"})) == ["desk-1", "desk-3", "desk-4"]


def test_the_name_of_this_host_is_an_id():
    assert check_id(f"{host_name()}-eval-1023", "name")


def test_an_actors_own_choices_win():
    options = ActorOptions(name="a", run="r", bus=BusConfig(), simulator="grid", maps=("generator:rooms",))
    config = RunConfig.model_validate({"maps": {"train": ["x"], "validation": ["y"]}})
    assert options.apply(config).simulator.name == "grid"
    assert options.apply(config).maps.train == ("generator:rooms",)
    assert options.apply(config).maps.validation == ("y",)
    evaluator = options.model_copy(update={"evaluate": True})
    assert evaluator.apply(config).maps.train == ("x",)
    assert evaluator.apply(config).maps.validation == ("generator:rooms",)
    assert ActorOptions.model_validate_json(options.model_dump_json()) == options


def test_a_run_that_names_modules_is_refused_before_a_process_starts():
    with LearnerEnd(free_port(), simulator={"name": "foreign_code:Simulator"}) as learner:
        for number in ("1", "2"):
            result = CliRunner().invoke(app, ["--num", number, "--connect", learner.endpoint])
            assert result.exit_code == 1
            assert "names the simulator 'foreign_code:Simulator'" in result.output
            assert "--allow MODULE:CLASS" in result.output
        assert not learner.presence.present() - {("learner", "learner")}


def test_an_unknown_simulator_is_named():
    result = CliRunner().invoke(app, ["--sim", "gird"])
    assert result.exit_code == 1
    assert "no simulator 'gird' (did you mean 'grid'?)" in result.output
