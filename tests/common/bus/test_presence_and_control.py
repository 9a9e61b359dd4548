import pytest

from common.bus.control import ControlServer, request
from common.bus.liveness import PresenceWatcher, declare_presence, present
from common.bus.query import ask
from common.bus.session import open_client_session, open_learner_session
from common.bus.stats import StatsTable, publish_stats
from common.errors import BusError, HDError, MessageError
from common.messages.codec import pack
from common.messages.replies import ROBOT_VERBS, ControlReply, ControlRequest
from common.messages.schema import decode, encode
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples


@pytest.fixture
def sessions():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        yield learner, client


def test_presence_is_seen_from_both_sides(sessions):
    learner, client = sessions
    changes = []
    with (
        declare_presence(client, "run", "actor", "desk-0"),
        PresenceWatcher(learner, "run", lambda process, there: changes.append((process, there))) as watcher,
    ):
        assert watcher.wait_for(lambda there: ("actor", "desk-0") in there, 5)
        with declare_presence(learner, "run", "learner", "learner"):
            assert eventually(lambda: ("learner", "learner") in present(client, "run"))
            assert watcher.wait_for(lambda there: len(there) == 2, 5)
        assert watcher.wait_for(lambda there: there == {("actor", "desk-0")}, 5)
        assert watcher.names("actor") == ("desk-0",)
        assert watcher.names("robot") == ()
        with declare_presence(client, "other", "actor", "desk-1"):
            assert not watcher.wait_for(lambda there: len(there) > 1, 0.2)
    assert changes == [
        (("actor", "desk-0"), True),
        (("learner", "learner"), True),
        (("learner", "learner"), False),
    ]


def test_statistics_are_tabled_by_process(sessions):
    learner, client = sessions
    actor, boss = samples.small_messages()[3:5]
    with StatsTable(learner, "run") as table:
        publish_stats(learner, "run", "learner", "learner", boss)
        assert eventually(lambda: ("learner", "learner") in table.rows())
        assert eventually(
            lambda: publish_stats(client, "run", "actor", "desk-0", actor) or ("actor", "desk-0") in table.rows()
        )
        stats, age = table.rows()["actor", "desk-0"]
        assert stats == actor
        assert 0 <= age < 5
        table.forget(("actor", "desk-0"))
        assert set(table.rows()) == {("learner", "learner")}


def test_false_statistics_are_counted_and_dropped(sessions):
    learner, client = sessions
    actor = samples.small_messages()[3]
    with StatsTable(learner, "run") as table:
        for key, payload in [("actor/desk-0", b"junk"), ("actor/desk-1", None), ("actor/desk-0", pack({"v": 1}))]:
            if payload is None:
                publish_stats(client, "run", "actor", "desk-1", actor)
            else:
                client.put(f"hd/run/stats/{key}", payload)
        assert eventually(lambda: table.invalid == 3)
        assert table.rows() == {}


def test_commands_are_acknowledged_with_the_state_after_them(sessions):
    learner, client = sessions
    paused = []

    def handle(command):
        if command.verb == "pause":
            paused.append(True)
        if command.verb == "checkpoint":
            raise HDError("the disk is full: free some space")
        return {"paused": bool(paused), "verb": command.verb}

    with ControlServer(learner, "run", handle):
        assert request(client, "run", "status") == {"paused": False, "verb": "status"}
        assert request(client, "run", "pause") == {"paused": True, "verb": "pause"}
        with pytest.raises(BusError, match="refused 'checkpoint': the disk is full"):
            request(client, "run", "checkpoint")
        with pytest.raises(BusError, match="must be one of"):
            request(client, "run", "explode")


def test_a_robot_knows_verbs_of_its_own_and_a_learner_does_not(sessions):
    learner, client = sessions
    with (
        ControlServer(learner, "run", lambda command: {}),
        ControlServer(learner, "r2", lambda command: dict(command.arguments), verbs=ROBOT_VERBS),
    ):
        assert request(client, "r2", "goal", arguments={"x": 1.5, "y": 2.0}, asked="robot") == {"x": 1.5, "y": 2.0}
        with pytest.raises(
            BusError, match="the robot 'r2' refused 'checkpoint': a command must be one of status, start"
        ):
            request(client, "r2", "checkpoint", asked="robot")
        with pytest.raises(BusError, match="refused 'return_home'"):
            request(client, "run", "return_home")


def test_a_command_without_a_learner_says_what_to_check(sessions):
    _, client = sessions
    with pytest.raises(BusError, match="no learner of the run 'run' answered within 0.3 s"):
        request(client, "run", "status", timeout=0.3)


def test_forged_commands_are_refused(sessions):
    learner, client = sessions
    carried_out = []
    with ControlServer(learner, "run", lambda command: carried_out.append(command.verb) or {}):
        for payload in (b"junk", None, encode(ControlRequest("stop"))):
            (reply,) = ask(client, "hd/run/control/status", 3.0, payload)
            assert not decode(reply.ok.payload.to_bytes(), ControlReply).ok
    assert carried_out == []


def test_an_unreadable_answer_is_an_error(sessions):
    learner, client = sessions
    queryable = learner.declare_queryable("hd/run/control/*", lambda query: query.reply(query.key_expr, b"junk"))
    with pytest.raises(MessageError):
        request(client, "run", "status")
    queryable.undeclare()
