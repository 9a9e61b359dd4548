"""An answering thread outlives whatever happens to one of its queries."""

import pytest

from common.bus.control import ControlServer, request
from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.query import QueryServer, ask
from common.bus.session import open_client_session, open_learner_session
from common.bus.spec import SpecServer, fetch_spec
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.errors import BusError
from common.messages.replies import Spec
from tests.common.bus.processes import loopback
from tests.common.messages import samples


@pytest.fixture
def sessions():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        yield learner, client


class FailsOnce:
    """Raises at the first call, and calls what it stands for ever after."""

    def __init__(self, rest):
        self.rest = rest
        self.calls = 0

    def __call__(self, *arguments):
        self.calls += 1
        if self.calls == 1:
            raise OverflowError("int too large to convert to float")
        return self.rest(*arguments)


def test_an_error_in_an_answer_is_logged_and_the_next_query_answered(sessions, caplog):
    learner, client = sessions
    answer = FailsOnce(lambda query: query.reply("hd/run/spec", b"here"))
    with QueryServer(learner, "hd/run/spec", answer):
        assert [reply for reply in ask(client, "hd/run/spec", 1.0) if reply.ok] == []
        (reply,) = ask(client, "hd/run/spec", 3.0)
        assert reply.ok.payload.to_bytes() == b"here"
    assert "answering a query on hd/run/spec failed and continues: OverflowError" in caplog.text
    assert "OverflowError" in caplog.text


def test_a_query_that_was_finished_by_its_handler_ends_nothing(sessions):
    learner, client = sessions

    def drop(query):
        query.drop()
        raise ValueError(str(query.key_expr))

    with QueryServer(learner, "hd/run/spec", drop) as server:
        for _ in range(2):
            assert ask(client, "hd/run/spec", 1.0) == []
        server._answer = lambda query: query.reply("hd/run/spec", b"here")
        assert ask(client, "hd/run/spec", 3.0)[0].ok.payload.to_bytes() == b"here"


def test_a_command_whose_handler_fails_is_answered_and_the_next_one_carried_out(sessions):
    learner, client = sessions
    with ControlServer(learner, "run", FailsOnce(lambda command: {"verb": command.verb})):
        with pytest.raises(BusError, match="refused 'pause': it failed, see the log: OverflowError: int too large"):
            request(client, "run", "pause", 3.0)
        assert request(client, "run", "stop", 3.0) == {"verb": "stop"}


def test_a_state_that_no_message_can_hold_is_answered_too(sessions):
    learner, client = sessions
    with ControlServer(learner, "run", lambda command: {"x": object()} if command.verb == "status" else {}):
        with pytest.raises(BusError, match="it failed, see the log"):
            request(client, "run", "status", 3.0)
        assert request(client, "run", "stop", 3.0) == {}


@pytest.mark.parametrize("part", ["weights", "spec", "experience"])
def test_every_server_of_the_bus_goes_on_after_an_error(sessions, part):
    learner, client = sessions
    if part == "weights":
        with WeightsPublisher(learner, "run") as publisher, WeightsPuller(client, "run", timer=60) as puller:
            publisher._server._answer = FailsOnce(publisher._answer)
            publisher.publish(samples.weights(version=1))
            assert puller.wait(20).version == 1
            assert publisher._server._answer.calls > 1
    elif part == "spec":
        with SpecServer(learner, Spec("run", 1, "{}")) as server:
            server._answer = FailsOnce(server._answer)
            assert fetch_spec(client, "run", 5.0).run == "run"
            assert server._answer.calls > 1
    else:
        stored = []
        with (
            ExperienceServer(learner, "run", 5, lambda delivery, payload: stored.append(delivery) or 0.0) as server,
            ExperienceSender(client, "run", "desk-0", ack_timeout=1.0) as sender,
        ):
            server._server._answer = FailsOnce(server._answer)
            assert sender.send(samples.report())
            assert sender.flush(10)
            assert len(stored) == 1
            assert server._server._answer.calls > 1
