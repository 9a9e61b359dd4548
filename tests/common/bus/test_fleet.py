"""Commands to several robots: nobody is forgotten, and who does not answer is named."""

import contextlib
import time

import pytest

from common.bus.control import ControlServer
from common.bus.fleet import bridges_at, command_all
from common.bus.liveness import declare_presence
from common.bus.session import open_client_session, open_learner_session
from common.errors import HDError
from common.messages.replies import ROBOT_VERBS
from tests.common.bus.processes import eventually, loopback


@pytest.fixture
def network():
    """A function that adds bridges to a network, and the session of an operator."""
    config = loopback()
    with contextlib.ExitStack() as stack:
        operator = stack.enter_context(open_learner_session(config))
        stopped = []

        def add(name, instance, *, answers=True, fails=False):
            session = stack.enter_context(open_client_session(config))

            def handle(command):
                if fails:
                    raise HDError("the brake is stuck")
                stopped.append(instance)
                return {"instance": instance, "verb": command.verb}

            if answers:
                stack.enter_context(ControlServer(session, name, handle, ROBOT_VERBS))
            stack.enter_context(declare_presence(session, name, "bridge", instance))
            assert eventually(lambda: (name, instance) in bridges_at(operator))

        yield add, operator, stopped


def test_a_stop_reaches_all_of_a_name_and_nobody_else(network):
    add, operator, stopped = network
    add("r1", "a")
    add("r1", "b")
    add("r2", "c")
    answers = command_all(operator, "r1", "stop", 5.0)
    assert set(answers.states) == {("r1", "a"), ("r1", "b")}
    assert not answers.missing
    assert set(stopped) == {"a", "b"}
    assert bridges_at(operator, "r2") == {("r2", "c")}


def test_without_a_name_it_reaches_every_robot_and_no_learner(network):
    add, operator, stopped = network
    add("r1", "a")
    add("r2", "c")
    ended = []
    with ControlServer(operator, "run", lambda command: ended.append(command.verb) or {}):
        answers = command_all(operator, None, "stop", 5.0)
    assert set(answers.states) == {("r1", "a"), ("r2", "c")}
    assert set(stopped) == {"a", "c"}
    assert ended == []


def test_one_that_does_not_answer_is_missing_and_does_not_keep_the_others_from_it(network):
    add, operator, stopped = network
    add("r1", "a")
    add("r1", "deaf", answers=False)
    began = time.monotonic()
    answers = command_all(operator, "r1", "stop", 1.5)
    assert set(answers.states) == {("r1", "a")}
    assert answers.missing == {("r1", "deaf")}
    assert ["robot 'r1'" in each and "instance deaf" in each for each in answers.problems(0.5)] == [True]
    assert stopped
    assert time.monotonic() - began < 4.0


def test_one_that_refuses_is_told(network):
    add, operator, _ = network
    add("r1", "a", fails=True)
    answers = command_all(operator, "r1", "stop", 1.0)
    assert answers.refusals == ["robot 'r1': the brake is stuck"]
    assert answers.missing == {("r1", "a")}


def test_nobody_is_there(network):
    _, operator, _ = network
    answers = command_all(operator, None, "stop", 0.3)
    assert (answers.states, answers.refusals, answers.missing) == ({}, [], frozenset())
