"""Certificates and access rules, tried with real TLS sessions on loopback."""

import json
import stat

import numpy as np
import pytest

from common.bus.control import ControlServer, request
from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.liveness import PresenceWatcher, declare_presence
from common.bus.query import ask
from common.bus.session import open_client_session, open_learner_session
from common.bus.spec import SpecServer, fetch_spec
from common.bus.stats import StatsTable, publish_stats
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.config import BusConfig
from common.errors import BusError, ConfigError
from common.messages.replies import Spec
from common.messages.schema import encode
from learner.certificates import access_rules, write_pki
from tests.common.bus.processes import eventually, free_port
from tests.common.messages import samples


@pytest.fixture(scope="module")
def pki(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pki")
    write_pki(folder, [], ["desk", "lab"], ["rover"])
    return folder


@pytest.fixture(scope="module")
def bus(pki):
    """A learner with everything that it serves; tests read what reached it."""
    config = BusConfig(
        listen=f"tls/127.0.0.1:{free_port()}", tls_access=str(pki / "access.json"), **files(pki, "learner")
    )
    stored, commands = [], []
    with (
        open_learner_session(config) as session,
        ExperienceServer(session, "run", 1, lambda delivery, payload: stored.append(delivery.actor) or 0.0) as server,
        WeightsPublisher(session, "run") as publisher,
        SpecServer(session, Spec("run", 1, "{}")),
        ControlServer(session, "run", lambda command: commands.append(command.verb) or {}),
        StatsTable(session, "run") as table,
        PresenceWatcher(session, "run") as watcher,
        declare_presence(session, "run", "learner", "learner"),
    ):
        publisher.publish(samples.weights(version=3))
        yield Bus(config.listen, session, server, table, watcher, stored, commands)


class Bus:
    def __init__(self, endpoint, session, server, table, watcher, stored, commands):
        self.endpoint, self.session, self.server = endpoint, session, server
        self.table, self.watcher, self.stored, self.commands = table, watcher, stored, commands


def files(folder, name):
    return {
        "tls_ca": str(folder / "ca.pem"),
        "tls_certificate": str(folder / f"{name}.pem"),
        "tls_key": str(folder / f"{name}.key"),
    }


def client(bus, folder, name):
    return open_client_session(BusConfig(listen=bus.endpoint, **files(folder, name)))


def test_an_actor_with_its_certificate_does_all_its_work(bus, pki):
    with (
        client(bus, pki, "desk") as session,
        declare_presence(session, "run", "actor", "desk-0"),
        ExperienceSender(session, "run", "desk-0") as sender,
        WeightsPuller(session, "run") as puller,
        PresenceWatcher(session, "run") as watcher,
    ):
        assert fetch_spec(session, "run", 10).run == "run"
        assert puller.wait(10).version == 3
        sender.send(samples.report())
        assert sender.flush(10)
        assert "desk-0" in bus.stored
        assert bus.watcher.wait_for(lambda there: ("actor", "desk-0") in there, 5)
        assert watcher.wait_for(lambda there: ("learner", "learner") in there, 5)
        stats = samples.small_messages()[3]
        assert eventually(
            lambda: publish_stats(session, "run", "actor", "desk-0", stats) or ("actor", "desk-0") in bus.table.rows()
        )
        broken = samples.chunk(np.random.default_rng(0))
        broken.rewards[:] = np.nan
        sender.send(broken)
        assert sender.flush(10), "the refusal must reach the actor too"
        assert sender.refused == 1


def test_an_actor_cannot_write_on_the_keys_of_another(bus, pki):
    stats = samples.small_messages()[3]
    before = bus.server.invalid.total()
    with client(bus, pki, "desk") as session, declare_presence(session, "run", "actor", "lab-0"):
        fetch_spec(session, "run", 10)
        forged = encode(samples.delivery(np.random.default_rng(0), actor="lab-0"))
        assert ask(session, "hd/run/experience/lab-0", 1.0, forged) == []
        assert ask(session, "hd/run/experience/*", 1.0, forged) == []
        assert ask(session, "hd/run/experience/lab", 1.0, forged) == []
        publish_stats(session, "run", "actor", "lab-0", stats)
        publish_stats(session, "run", "learner", "learner", stats)
        session.put("hd/run/weights/notice", encode(samples.weights(version=99).notice()))
        with pytest.raises(BusError, match="no learner"):
            request(session, "run", "stop", timeout=0.5)
        # Its own key still works, so the link was alive all the time.
        assert ask(
            session, "hd/run/experience/desk", 5.0, encode(samples.delivery(np.random.default_rng(0), actor="desk"))
        )
    assert "lab-0" not in bus.stored
    assert bus.server.invalid.total() == before
    assert ("actor", "lab-0") not in bus.table.rows()
    assert ("actor", "lab-0") not in bus.watcher.present()
    assert bus.commands == []


def test_a_false_learner_is_not_heard(bus, pki):
    """An actor that answers for the learner reaches nobody else."""
    with client(bus, pki, "desk") as false, client(bus, pki, "lab") as victim:
        fetch_spec(victim, "run", 10)
        with SpecServer(false, Spec("forged", 666, "{}")), declare_presence(false, "forged", "learner", "learner"):
            with pytest.raises(BusError, match="no learner"):
                fetch_spec(victim, "forged", 1.0)
            with PresenceWatcher(victim, "forged") as watcher:
                assert not watcher.wait_for(bool, 0.3)


def test_a_robot_reads_weights_and_delivers_nothing(bus, pki):
    with client(bus, pki, "rover") as session, WeightsPuller(session, "run") as puller:
        with declare_presence(session, "run", "robot", "rover"):
            assert puller.wait(10).version == 3
            assert bus.watcher.wait_for(lambda there: ("robot", "rover") in there, 5)
        forged = encode(samples.delivery(np.random.default_rng(0), actor="rover"))
        assert ask(session, "hd/run/experience/rover", 1.0, forged) == []
    assert "rover" not in bus.stored


def test_the_operator_commands_and_watches(bus, pki):
    with client(bus, pki, "operator") as session:
        assert request(session, "run", "status", timeout=10) == {}
        assert bus.commands.pop() == "status"
        stats = samples.small_messages()[4]
        with StatsTable(session, "run") as table:
            assert eventually(
                lambda: publish_stats(bus.session, "run", "learner", "learner", stats) or bool(table.rows())
            )


@pytest.mark.parametrize("kind", ["none", "other authority", "unknown name"])
def test_strangers_get_nothing(bus, pki, tmp_path, kind):
    if kind == "unknown name":
        # A certificate of the right authority whose name no rule knows.
        for name in ("ca.pem", "ca.key"):
            (tmp_path / name).write_bytes((pki / name).read_bytes())
    write_pki(tmp_path, [], ["desk", "stranger"], [])
    config = BusConfig(listen=bus.endpoint, **files(tmp_path, "stranger" if kind == "unknown name" else "desk"))
    if kind == "none":
        config = BusConfig(listen=bus.endpoint.replace("tls/", "tcp/"))
    with open_client_session(config) as session:
        with pytest.raises(BusError, match="no learner"):
            fetch_spec(session, "run", 1.0)
        forged = encode(samples.delivery(np.random.default_rng(0), actor="desk"))
        before = len(bus.stored)
        assert ask(session, "hd/run/experience/desk", 0.5, forged) == []
        assert len(bus.stored) == before


def test_secrets_are_readable_by_their_owner_alone(pki):
    for key in pki.glob("*.key"):
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert {path.stem for path in pki.glob("*.key")} == {"ca", "learner", "operator", "desk", "lab", "rover"}


def test_more_names_are_added_without_touching_the_others(tmp_path):
    write_pki(tmp_path, [], ["desk"], [])
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    written = write_pki(tmp_path, [], ["lab"], ["rover"])
    names = {"lab.pem", "lab.key", "rover.pem", "rover.key", "access.json", "names.json"}
    assert {path.name for path in written} == names
    for name, content in before.items():
        assert name in names or (tmp_path / name).read_bytes() == content
    subjects = json.loads((tmp_path / "access.json").read_text())["subjects"]
    assert [subject["id"] for subject in subjects] == ["learner", "operator", "desk", "lab", "rover"]
    # A new address of the learner needs a new certificate of the learner alone.
    written = write_pki(tmp_path, ["gpu-host"], [], [])
    assert {path.name for path in written} == {"learner.pem", "learner.key", "access.json", "names.json"}


@pytest.mark.parametrize(
    ("actors", "robots", "words"),
    [
        (["Desk"], [], "lower-case"),
        (["a/b"], [], "lower-case"),
        (["learner"], [], "reserved"),
        (["desk"], ["desk"], "given twice"),
        (["desk", "desk"], [], "given twice"),
        (["desk", "desk-2"], [], "cover the actors of 'desk-2'"),
    ],
)
def test_names_that_would_weaken_the_rules_are_refused(tmp_path, actors, robots, words):
    with pytest.raises(ConfigError, match=words):
        access_rules(actors, robots)
    with pytest.raises(ConfigError, match=words):
        write_pki(tmp_path, [], actors, robots)
    assert not list(tmp_path.iterdir())


def test_half_an_authority_is_an_error(tmp_path):
    write_pki(tmp_path, [], [], [])
    (tmp_path / "ca.key").unlink()
    with pytest.raises(ConfigError, match=r"ca\.key is missing"):
        write_pki(tmp_path, [], ["desk"], [])
