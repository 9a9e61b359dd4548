"""Commands to a learner with more actors than one reply holds."""

import dataclasses
import json

import pytest
from typer.testing import CliRunner

from common.bus.control import ControlServer
from common.bus.session import open_learner_session
from learner.cli import app
from tests.common.bus.processes import loopback
from tests.learner.watch.test_view import ACTOR, STATUS


@pytest.mark.parametrize("seconds", ["inf", "1e30", "nan", "0"])
def test_a_timeout_is_one(seconds):
    done = CliRunner().invoke(app, ["status", "--timeout", seconds])
    assert done.exit_code == 2
    assert "Invalid value for '--timeout'" in done.output


def test_the_status_of_three_thousand_actors_can_be_read():
    names = [f"desk-{number:05d}" for number in range(3000)]
    status = dataclasses.replace(STATUS, actors=[dataclasses.replace(ACTOR, name=name) for name in names])
    asked = []

    def handle(request):
        asked.append(request.arguments)
        return status.page(str(request.arguments.get("after", "")))

    config = loopback()
    with open_learner_session(config) as session, ControlServer(session, "office", handle):
        arguments = ["status", "--run", "office", "--connect", config.listen, "--json", "--timeout", "10"]
        done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert [actor["name"] for actor in json.loads(done.stdout)["actors"]] == names
    assert len(asked) > 2
