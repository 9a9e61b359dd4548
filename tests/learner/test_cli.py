import json

import pytest
from typer.testing import CliRunner

from common.config import RunConfig
from common.config.load import load_config
from learner.cli import app
from learner.run.folder import RunFolder

COMMANDS = [
    "start", "resume", "status", "stop", "checkpoint", "export", "config", "certificates", "pause", "unpause",
    "doctor",
]  # fmt: skip


def run(*arguments):
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command):
    result = run(command, "--help")
    assert result.exit_code == 0
    assert "Example" in result.output and f"hd-learner {command}" in result.output


def test_config_prints_what_it_reads_back(tmp_path):
    result = run("config", "--preset", "workstation", "--set", "learner.batch_size=32", "--run", "office")
    assert result.exit_code == 0
    file = tmp_path / "run.toml"
    file.write_text(result.output)
    config = load_config(file)
    assert (config.name, config.learner.batch_size, config.network.width) == ("office", 32, 64)
    assert "learner.batch_size" in run("config", "--describe").output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("config", "--set", "learner.batchsize=3"), "did you mean"),
        (("config", "--set", "learner.batch_size=none"), "learner.batch_size"),
        (("start", "--serial", "--actors", "2"), "leave --actors"),
        (("start", "--serial", "--page", "8080"), "leave --page"),
        (("resume", "--run", "absent", "--runs", "{folder}"), "there is no run 'absent'"),
        (("export", "--run", "absent", "--runs", "{folder}"), "there is no run 'absent'"),
        (("start", "--runs", "{folder}", "--set", "maps.train=generator:romms"), "did you mean 'rooms'"),
        (("start", "--runs", "{folder}", "--set", "maps.validation=/nowhere#validation"), "--maps-elsewhere"),
        (
            ("start", "--runs", "{folder}", "--set", "maps.train=generator:romms", "--maps-elsewhere", "--serial"),
            "did you mean 'rooms'",
        ),
        (
            ("start", "--runs", "{folder}", "--metrics", "203.0.113.7:9100"),
            "--metrics cannot listen on 203",
        ),
        (("start", "--runs", "{folder}", "--page", "203.0.113.7:8080"), "--page cannot listen on 203"),
        (("start", "--runs", "{folder}", "--set", "learner.device=gpu"), "expected auto, cpu, cuda or cuda:N"),
        (("start", "--runs", "{folder}", "--set", "checkpoints.mirror=bucket/runs"), "expected a URL such as s3:"),
        (
            ("start", "--runs", "{folder}", "--set", "learner.initial_policy=absent.safetensors", "--serial"),
            "there is no file absent.safetensors",
        ),
        (
            ("start", "--runs", "{folder}", "--set", "learner.initial_policy=exploration", "--set", "network.heads=4"),
            "exploration does not fit the network: ",
        ),
        (("doctor", "--run", "absent", "--runs", "{folder}"), "there is no run 'absent'"),
        (("status", "--connect", "nonsense", "--timeout", "0.2"), "an endpoint must be"),
        (("status", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.2"), "no learner answers"),
        (("stop", "--run", "office", "--connect", "tcp/127.0.0.1:9", "--timeout", "0.2"), "no learner of the run"),
    ],
)
def test_errors_are_one_clear_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.setenv("HD_PROCESS_PREPARED", "1")
    result = run(*(part.replace("{folder}", str(tmp_path)) for part in arguments))
    assert result.exit_code == 1
    assert words in result.output
    assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_certificates_are_listed_as_they_are_made(tmp_path):
    result = run("certificates", str(tmp_path / "pki"), "--actor", "desk", "--robot", "jackal")
    assert result.exit_code == 0
    names = json.loads((tmp_path / "pki" / "names.json").read_text())
    assert names["actors"] == ["desk"] and names["robots"] == ["jackal"]
    assert "desk.pem" in result.output


def test_a_folder_that_was_renamed_names_its_run(tmp_path, monkeypatch):
    monkeypatch.setenv("HD_PROCESS_PREPARED", "1")
    RunFolder.create(tmp_path, RunConfig(name="office")).close()
    (tmp_path / "office").rename(tmp_path / "copy")
    result = run("resume", "--run", "copy", "--runs", str(tmp_path))
    assert result.exit_code == 1
    assert "holds the run 'office'" in " ".join(result.output.split())
