"""What a user sees when a command fails."""

import errno
import io
import os
import subprocess
import sys
from typing import Annotated

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from common.cli import CommandApp, command_errors, output_console, whole_table
from common.errors import ConfigError


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ConfigError("a.b: expected [1], got x"), 1, "error: a.b: expected [1], got x"),
        (KeyboardInterrupt(), 130, "inter"),
        (
            OSError(errno.ENOSPC, "No space left on device", "runs/demo/verdict.json"),
            1,
            "runs/demo/verdict.json: make room",
        ),
        (
            OSError(errno.EROFS, "Read-only file system", "pki"),
            1,
            "error: cannot use pki (Read-only file system): check its permissions",
        ),
    ],
)
def test_errors_are_one_line_and_a_non_zero_exit(error, code, words):
    app = typer.Typer()

    @app.command()
    @command_errors
    def fail() -> None:
        raise error

    result = CliRunner().invoke(app, [])
    assert result.exit_code == code
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_help_keeps_examples_on_their_lines_and_what_stands_in_brackets():
    app = CommandApp()

    @app.command(epilog="Rows:\n\n  one  1\n\n  two  2\n")
    def sail(where: Annotated[str | None, typer.Option(help="Port. [default: home]")] = None) -> None:
        """Put out to sea, for as long as there is wind
        and water.

        Examples:
        - `sail --where Samarkand`

        - `sail`
        """

    words = CliRunner().invoke(app, ["--help"]).output
    assert "Put out to sea, for as long as there is wind and water." in words
    assert "  Examples:\n  - `sail --where Samarkand`\n\n  - `sail`\n" in words
    assert "Port. [default: home]" in words
    assert "    one  1\n\n    two  2\n" in words


def test_other_errors_of_the_system_are_not_hidden():
    @command_errors
    def command() -> None:
        raise OSError(errno.EIO, "Input/output error")

    with pytest.raises(OSError, match="Input/output"):
        command()


def test_names_between_colons_stay_as_they_are(capsys) -> None:
    @command_errors
    def command() -> None:
        raise ConfigError("generator:office: no such thing")

    with pytest.raises(typer.Exit):
        command()
    assert "generator:office: no such thing" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ("learner", "config", "--describe"),
        ("learner", "--help"),
        ("actors", "--help"),
        ("deploy", "bridge", "--help"),
        ("deploy", "config", "--describe"),
        ("deploy", "config", "--config", "größe≥.toml"),
    ],
    ids=" ".join,
)
def test_a_terminal_that_is_not_utf_8_is_written_to(command):
    environment = {**os.environ, "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    done = subprocess.run([sys.executable, "-m", *command], env=environment, capture_output=True, check=False)
    output = done.stdout + done.stderr
    assert b"Traceback" not in output and b"Error:" not in output, output[-500:]
    # The last one names a file that is not there.
    assert done.returncode == int("--config" in command), output[-500:]
    assert len(output) > 50


def test_tables_in_a_pipe_or_a_narrow_terminal_lose_nothing(capsys):
    topic = "/a/very/long/name/of/a/topic/that/nobody/would/want/to/see/cut/short" * 3
    table = whole_table("topic", "type")
    table.add_row(topic, "generator:office: no emoji")
    output_console().print(table)
    piped = capsys.readouterr().out
    assert topic in piped
    assert "generator:office: no emoji" in piped
    narrow = Console(file=io.StringIO(), width=40)
    narrow.print(table)
    assert "…" not in narrow.file.getvalue()
