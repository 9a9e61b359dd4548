"""Messages of strangers: on keys of other roles, under names that are none, and many of them."""

import numpy as np
import pytest

from common.bus.control import ControlServer, request
from common.bus.liveness import PresenceWatcher, present
from common.bus.session import open_client_session, open_learner_session
from common.bus.stats import StatsTable, publish_stats
from common.messages.schema import encode
from common.messages.stats import ActorStats, LearnerStats
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples


@pytest.fixture
def sessions():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        yield learner, client


MESSAGES = samples.small_messages()
OF_ACTOR = next(message for message in MESSAGES if isinstance(message, ActorStats))
OF_LEARNER = next(message for message in MESSAGES if isinstance(message, LearnerStats))


@pytest.mark.parametrize(
    ("role", "name", "stats"),
    [
        ("actor", OF_ACTOR.actor, OF_LEARNER),
        ("evaluator", OF_ACTOR.actor, OF_LEARNER),
        ("robot", OF_ACTOR.actor, OF_LEARNER),
        ("learner", "learner", OF_ACTOR),
        ("learner", OF_ACTOR.actor, OF_ACTOR),
        ("actor", "another", OF_ACTOR),
        ("boss", OF_ACTOR.actor, OF_ACTOR),
        ("actor", "desk\x1b[2J", OF_ACTOR),
    ],
)
def test_statistics_are_those_of_the_role_of_their_key(sessions, role, name, stats):
    learner, client = sessions
    with StatsTable(learner, "run") as table:
        assert eventually(
            lambda: publish_stats(client, "run", "actor", OF_ACTOR.actor, OF_ACTOR) or bool(table.rows()), 5.0
        )
        table.forget(("actor", OF_ACTOR.actor))
        before = table.invalid
        client.put(f"hd/run/stats/{role}/{name}", encode(stats))
        assert eventually(lambda: table.invalid > before, 5.0)
        assert all(isinstance(held, ActorStats) for held, _ in table.rows().values())
        assert ("learner", "learner") not in table.rows()


def test_presence_under_a_name_that_is_none_is_no_presence(sessions):
    learner, client = sessions
    with PresenceWatcher(learner, "run") as watcher:
        tokens = [
            client.liveliness().declare_token(f"hd/run/live/{key}")
            for key in ("actor/desk\x1b[2J", "boss/desk-0", "actor/Desk", "actor/desk-0")
        ]
        assert watcher.wait_for(lambda present: ("actor", "desk-0") in present, 5.0)
        assert watcher.present() == {("actor", "desk-0")}
        assert present(learner, "run") == {("actor", "desk-0")}
        for token in tokens:
            token.undeclare()


def test_an_error_in_what_presence_tells_ends_nothing(sessions, caplog):
    learner, client = sessions
    told = []

    def on_change(process, appeared):
        told.append((process, appeared))
        raise KeyError("nobody expected this")

    with PresenceWatcher(learner, "run", on_change):
        for name in ("desk-0", "desk-1"):
            with client.liveliness().declare_token(f"hd/run/live/actor/{name}"):
                assert eventually(lambda name=name: (("actor", name), True) in told, 5.0)
    assert "watching presence failed and continues: KeyError" in caplog.text


def test_answers_of_a_false_learner_reach_no_terminal_raw(sessions):
    learner, client = sessions
    with ControlServer(learner, "run", lambda command: {"state": "\x1b[2Jfine", "numbers": np.arange(2).tolist()}):
        assert request(client, "run", "status", 5.0) == {"state": "\\x1b[2Jfine", "numbers": [0, 1]}


def test_tokens_without_end_fill_no_memory_and_go_again(sessions, monkeypatch, caplog):
    learner, client = sessions
    monkeypatch.setattr("common.bus.liveness.MAX_PRESENT", 10)
    with PresenceWatcher(learner, "run") as watcher:
        tokens = [client.liveliness().declare_token(f"hd/run/live/actor/wide-{number}") for number in range(30)]
        assert watcher.wait_for(lambda present: len(present) == 10, 5.0)
        assert eventually(lambda: "further ones are not shown" in caplog.text, 5.0)
        for token in tokens:
            token.undeclare()
        assert watcher.wait_for(lambda present: not present, 5.0)
        with client.liveliness().declare_token("hd/run/live/actor/desk-0"):
            assert watcher.wait_for(lambda present: ("actor", "desk-0") in present, 5.0)
    assert caplog.text.count("further ones are not shown") == 1
