"""What the status tells as the last error, and for how long."""

import logging
import time

import pytest

from common.system.logs import lasting
from deploy.bridge.problems import LastProblem
from deploy.config import DeployConfig
from deploy.mapping.robot_map import RobotMap

log = logging.getLogger("tests.problems")


@pytest.fixture
def problems():
    with LastProblem() as problems:
        yield problems


def text(problems):
    return None if problems.problem is None else problems.problem.text


@pytest.fixture
def later(monkeypatch):
    """A function that lets time pass, seconds."""
    clock = time.monotonic
    passed = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock() + passed[0])
    return lambda seconds: passed.__setitem__(0, passed[0] + seconds)


def test_what_lasts_is_told_until_it_is_over_and_an_event_for_a_minute(problems, later):
    assert problems.problem is None
    broken = {"arm", "leg"}
    log.error("the arm is broken", extra=lasting(lambda: "arm" in broken))
    log.error("the leg is broken", extra=lasting(lambda: "leg" in broken))
    log.warning("a command is refused")
    log.info("all is well")
    assert text(problems) == "a command is refused"
    later(61.0)
    assert text(problems) == "the leg is broken"
    assert problems.problem.age == pytest.approx(61.0, abs=1.0)
    broken.remove("leg")
    assert text(problems) == "the arm is broken"
    broken.clear()
    assert problems.problem is None


def test_scans_that_are_refused_are_told_while_they_come(problems, later):
    robot_map = RobotMap(DeployConfig())
    robot_map.refuse("scan refused", "ranges are negative")
    assert "ranges are negative" in text(problems)
    later(4.0)
    assert text(problems)
    later(4.0)
    assert problems.problem is None
    robot_map.refuse("scan refused", "ranges are negative")
    assert "ranges are negative" in text(problems), "it is in the log once, and goes on"
