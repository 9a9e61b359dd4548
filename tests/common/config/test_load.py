"""Precedence of the sources of settings, and the messages that a user reads when one is wrong."""

import json
import re

import pytest

from common.config import RunConfig, load_config, preset_names, resolve
from common.config.describe import to_markdown, to_toml
from common.config.load import all_fields
from common.errors import ConfigError


def test_later_sources_win_over_earlier_ones(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("[learner]\nbatch_size = 11\nthreads = 3\ndevice = 'cpu'\n")
    environment = {
        "HD_LEARNER__BATCH_SIZE": "22",
        "HD_LEARNER__THREADS": "4",
        "PATH": "/bin",
        "HD_PAGE_TOKEN": "no setting",
    }
    config = load_config(file, ["learner.batch_size=33"], environment)
    assert (config.learner.batch_size, config.learner.threads, config.learner.device) == (33, 4, "cpu")


def test_a_file_builds_upon_a_preset(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("[network]\nlayers = 2\n")
    config = load_config(file, preset="workstation")
    assert (config.network.layers, config.network.width) == (2, 64)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_valid(name):
    assert isinstance(load_config(preset=name), RunConfig)


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("maps.train=a,b", ("a", "b")),
        ('maps.train=["generator:rooms?a=1,2"]', ("generator:rooms?a=1,2",)),
        ("simulator.sense_every=null", None),
        ("simulator.sense_every=0.5", 0.5),
        ("simulator.lidar_layers=16", 16),
        ("name=7", "7"),
        ("sac.learn_temperature=false", False),
    ],
)
def test_command_line_values_are_read_as_the_setting_wants_them(override, value):
    config = load_config(overrides=[override])
    found = config
    for part in override.partition("=")[0].split("."):
        found = getattr(found, part)
    assert found == value


@pytest.mark.parametrize(
    ("overrides", "environment", "words"),
    [
        (["learner.batchsize=3"], {}, ["learner.batchsize", "did you mean 'learner.batch_size'"]),
        (["learner.batch_size=many"], {}, ["learner.batch_size", "integer", "'many'", "--set"]),
        (["learner.batch_size=0"], {}, ["learner.batch_size", "greater than or equal to 1", "got 0"]),
        ([], {"HD_SAC__GAMMA": "1.5"}, ["sac.gamma", "HD_SAC__GAMMA", "1.5"]),
        ([], {"HD_SAC__GAMA": "0.5"}, ["HD_SAC__GAMA", "did you mean 'sac.gamma'"]),
        (["network.heads=7"], {}, ["network", "heads (7) must divide width (128)"]),
        (["nonsense"], {}, ["section.field=value", "'nonsense'"]),
        (["name=Über"], {}, ["name", "lower-case letters"]),
        (["bus.tls_ca=ca.pem"], {}, ["tls_certificate", "all three or none"]),
        (["sac.gamma=NaN"], {}, ["sac.gamma", "finite"]),
        (["seed=99999999999999999999"], {}, ["seed", "less than or equal to"]),
        (["mapping.sensor_range=1e300"], {}, ["mapping.sensor_range", "less than or equal to 1000000"]),
        (["maps.metres_per_pixel=1e300"], {}, ["maps.metres_per_pixel", "less than or equal to"]),
        (["sac.gamma=true"], {}, ["sac.gamma", "a number, and not true or false"]),
    ],
)
def test_a_wrong_setting_is_explained(overrides, environment, words):
    with pytest.raises(ConfigError) as caught:
        load_config(None, overrides, environment)
    for word in words:
        assert word in str(caught.value)


def test_unknown_names_in_a_file_are_explained_with_the_file(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("[learner]\nbatch_sizes = 3\n[nothing]\nx = 1\n")
    with pytest.raises(ConfigError, match="learner.batch_sizes") as caught:
        load_config(file)
    assert str(file) in str(caught.value)
    assert "nothing" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("run.json", '{"learner": {"batch_size": 8}, "learner": {}}', "'learner' is there twice"),
        ("run.toml", "[sac]\ngamma = true", "sac.gamma: input should be a number"),
        ("run.toml", "[Learner]\nbatch_size = 8", "Learner: unknown section: did you mean 'learner'? (from file"),
        ("run.toml", '"learner.batch_size" = 8', "a key with dots is one name: write 'batch_size' in the section"),
        ("run.toml", "learner = 3", "learner: expected a table of settings, got 3"),
        ("run.json", '{"learner": null}', "learner: expected a table of settings, got None (from file"),
    ],
)
@pytest.mark.parametrize("overrides", [[], ["learner.batch_size=4"]])
def test_files_that_say_something_else_than_they_mean(tmp_path, name, text, words, overrides):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(ConfigError, match=re.escape(words)):
        load_config(file, overrides)


def test_the_suffix_of_a_file_may_be_in_capitals(tmp_path):
    file = tmp_path / "RUN.JSON"
    file.write_text('{"learner": {"batch_size": 4}}')
    assert load_config(file).learner.batch_size == 4


@pytest.mark.parametrize("text", ["[learner", "= 3", "\x00"])
def test_a_broken_file_is_reported(tmp_path, text):
    file = tmp_path / "run.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match="run.toml"):
        load_config(file)
    with pytest.raises(ConfigError, match="absent.toml"):
        load_config(tmp_path / "absent.toml")


def test_a_text_in_place_of_a_list_of_settings_is_explained():
    with pytest.raises(ConfigError, match=r"expected a list.*write \['learner.batch_size=8'\]"):
        load_config(overrides="learner.batch_size=8")


def test_unknown_preset_lists_the_known_ones():
    with pytest.raises(ConfigError, match="workstation"):
        load_config(preset="mainframe")


def test_the_resolved_configuration_reads_back_equal(tmp_path):
    config = load_config(overrides=["maps.train=a,b", "simulator.sense_every=2", "sac.huber_delta=null"])
    assert resolve(json.loads(config.model_dump_json())) == config
    file = tmp_path / "resolved.toml"
    file.write_text(to_toml(config))
    assert load_config(file) == config


def test_families_read_back_equal(tmp_path):
    config = load_config(preset="mix")
    assert config.families
    file = tmp_path / "resolved.toml"
    file.write_text(to_toml(config))
    assert load_config(file) == config


def test_every_setting_is_documented():
    reference = to_markdown()
    for path, field in all_fields():
        assert field.description, path
        assert f"`{path}`" in reference


@pytest.mark.parametrize(
    "override",
    ["bus.ack_timeout=1e300", "bus.lease=1e-9", "actor.weights_timeout=1e12", "checkpoints.every_seconds=1e300"],
)
def test_no_wait_is_longer_than_a_timer_can_count(override):
    with pytest.raises(ConfigError, match=override.partition("=")[0]):
        load_config(overrides=[override])


def test_actors_can_be_told_where_the_learner_listens():
    for endpoint in ("tcp/127.0.0.1:0", "tcp/[::1]:00?rel=1#iface=lo"):
        with pytest.raises(ConfigError, match="port 0"):
            load_config(overrides=[f"bus.listen={endpoint}"])
    assert load_config(overrides=["bus.listen=tcp/[::1]:7440?rel=0"]).bus.listen == "tcp/[::1]:7440?rel=0"
