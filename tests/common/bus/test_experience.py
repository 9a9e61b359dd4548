"""Delivery inside one process; tests/common/bus/test_faults.py kills, freezes and restarts."""

import contextlib
import threading
import time

import numpy as np
import pytest
import zenoh

from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.query import ask
from common.bus.seen import SeenSet
from common.bus.session import open_client_session, open_learner_session
from common.errors import RefusedError, StorageError
from common.messages.codec import pack
from common.messages.experience import Delivery
from common.messages.replies import Ack
from common.messages.schema import decode, encode
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples


@pytest.fixture
def sessions():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        yield learner, client


class Store:
    """Keeps deliveries once each, as the learner does, and tells what it was told to."""

    def __init__(self):
        self.deliveries: list[Delivery] = []
        self.payloads: list[bytes] = []
        self.seen = SeenSet()
        self.hold = 0.0
        self.failures = 0
        self.refusal = ""

    def __call__(self, delivery: Delivery, payload: bytes) -> float:
        if self.failures:
            self.failures -= 1
            raise OSError("disk full")
        if self.refusal:
            raise RefusedError(self.refusal)
        if self.seen.add(delivery.actor, delivery.incarnation, delivery.sequence):
            self.deliveries.append(delivery)
            self.payloads.append(payload)
        return self.hold

    @property
    def sequences(self):
        return [delivery.sequence for delivery in self.deliveries]


def test_everything_arrives_once_in_the_learner(sessions):
    learner, client = sessions
    store, rng = Store(), np.random.default_rng(0)
    bodies = [samples.chunk(rng) for _ in range(40)]
    # Patient: a busy machine may answer so late that a message is sent again, which the store would see twice.
    patient = ExperienceSender(client, "run", "desk-0", ack_timeout=60.0)
    with ExperienceServer(learner, "run", 5, store) as server, patient as sender:
        assert all(sender.send(body) for body in bodies)
        assert sender.send(samples.report())
        assert sender.flush(60)
        assert sorted(store.sequences) == list(range(41))
        assert server.acknowledged == sender.acknowledged == 41
        assert sender.pending == 0
        assert sender.learner_present
        assert sender.learner == 5
        by_sequence = {delivery.sequence: delivery for delivery in store.deliveries}
        for sequence, body in enumerate(bodies):
            assert encode(by_sequence[sequence]) == encode(Delivery("desk-0", sender.incarnation, sequence, body))
        assert by_sequence[40].body == samples.report()


def test_the_same_sequence_is_acknowledged_again_and_comes_with_its_bytes(sessions):
    learner, client = sessions
    store = Store()
    data = encode(samples.delivery(np.random.default_rng(0), 3))
    with ExperienceServer(learner, "run", 5, store):
        for _ in range(3):
            (reply,) = ask(client, "hd/run/experience/desk-0", 3.0, data)
            assert decode(reply.ok.payload.to_bytes(), Ack) == Ack(3, True, 0.0, "", 5)
    assert store.sequences == [3]
    assert store.payloads == [data]


def test_a_refusal_of_the_store_reaches_the_actor_and_is_final(sessions, caplog):
    learner, client = sessions
    store = Store()
    store.refusal = "desk-0 is refused"
    with ExperienceServer(learner, "run", 5, store) as server, ExperienceSender(client, "run", "desk-0") as sender:
        for _ in range(30):
            sender.send(samples.report())
        assert sender.flush(10)
        assert (sender.refused, sender.acknowledged) == (30, 0)
        assert server.invalid == {"desk-0": 30}
    # Not one line for each: an actor may continue like that for days.
    assert 1 <= caplog.text.count("the learner refused message") < 10


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "needs 1 bytes"),
        (b"junk", "must be a map"),
        (pack({"v": 9, "kind": "delivery"}), "the sender has a newer release; install the same release"),
        (pack({"v": 2, "kind": "delivery"}), "the sender has an older release; install the same release"),
        (encode(samples.delivery(np.random.default_rng(0), actor="desk-1")), "as in the key"),
        (encode(samples.weights()), "must be one of delivery"),
    ],
)
def test_invalid_messages_are_refused_counted_and_change_nothing(sessions, caplog, data, words):
    learner, client = sessions
    store = Store()
    with ExperienceServer(learner, "run", 5, store) as server:
        (reply,) = ask(client, "hd/run/experience/desk-0", 3.0, data)
        ack = decode(reply.err.payload.to_bytes(), Ack)
        assert not ack.stored
        assert words in ack.error
        assert server.invalid == {"desk-0": 1}
        assert "refused a message of desk-0" in caplog.text
        assert store.deliveries == []


def test_a_refused_message_is_not_sent_again(sessions, caplog):
    learner, client = sessions
    broken = samples.chunk(np.random.default_rng(0))
    broken.rewards[:] = np.nan
    store = Store()
    with ExperienceServer(learner, "run", 5, store), ExperienceSender(client, "run", "desk-0") as sender:
        sender.send(broken)
        sender.send(samples.report())
        assert sender.flush(10)
        assert (sender.refused, sender.acknowledged) == (1, 1)
        assert "rewards: must be from -1e+06 to 1e+06, got nan at place 0" in caplog.text


def test_what_could_not_be_stored_is_sent_again(sessions, caplog):
    learner, client = sessions
    store = Store()
    store.failures = 1
    with ExperienceServer(learner, "run", 5, store), ExperienceSender(client, "run", "desk-0") as sender:
        sender.send(samples.report())
        assert sender.flush(10)
        assert store.sequences == [0]
        assert sender.acknowledged == 1
    assert "could not be stored" in caplog.text


def test_a_slow_learner_is_no_unreadable_one(sessions, caplog):
    learner, client = sessions
    order = []

    def store(delivery, payload):
        order.append(delivery.sequence)
        time.sleep(1.5 if len(order) == 2 else 0.0)
        return 0.0

    with (
        ExperienceServer(learner, "run", 5, store),
        ExperienceSender(client, "run", "desk-0", ack_timeout=0.4) as sender,
    ):
        for _ in range(2):
            sender.send(samples.report())
            assert sender.flush(10)
        assert sender.acknowledged == 2
    # The same bytes came again and again; that they count once is the store's business.
    assert set(order) == {0, 1}
    assert "does not answer" in caplog.text
    assert "cannot be read" not in caplog.text


def test_nothing_is_acknowledged_before_the_disk_has_it(sessions):
    learner, client = sessions
    store, waiting = Store(), []
    with (
        ExperienceServer(learner, "run", 5, store, when_durable=waiting.append),
        ExperienceSender(client, "run", "desk-0") as sender,
    ):
        sender.send(samples.report())
        assert eventually(lambda: waiting)
        time.sleep(0.1)
        assert (len(store.deliveries), sender.acknowledged) == (1, 0)
        waiting.pop()(True)
        assert sender.flush(10)
        for _ in range(10):
            sender.send(samples.report())
        # One slow sync delays no other delivery: all that the window lets through are stored meanwhile.
        assert eventually(lambda: len(waiting) == 10)
        assert (len(store.deliveries), sender.acknowledged) == (11, 1)
        for tell in waiting:
            tell(True)
        assert sender.flush(10)
        assert sender.acknowledged == 11


def test_what_the_disk_refuses_comes_again_and_is_stored_once(sessions):
    learner, client = sessions
    store, answers = Store(), [False, True]
    with (
        ExperienceServer(learner, "run", 5, store, when_durable=lambda tell: tell(answers.pop(0))) as server,
        ExperienceSender(client, "run", "desk-0") as sender,
    ):
        sender.send(samples.report())
        assert sender.flush(10)
        assert (len(store.deliveries), server.acknowledged, sender.acknowledged) == (1, 2, 1)


def test_a_refusal_of_the_disk_is_no_traceback(sessions, caplog):
    learner, client = sessions
    problems = [StorageError("no room")] * 2

    def store(delivery, payload):
        if problems:
            raise problems.pop()
        return 0.0

    with ExperienceServer(learner, "run", 5, store), ExperienceSender(client, "run", "desk-0") as sender:
        sender.send(samples.report())
        assert sender.flush(10)
    assert not problems and "Traceback" not in caplog.text and "no room" not in caplog.text


def test_actors_are_told_to_pause(sessions):
    learner, client = sessions
    store = Store()
    store.hold = 30.0
    with ExperienceServer(learner, "run", 5, store), ExperienceSender(client, "run", "desk-0") as sender:
        assert sender.hold == 0.0
        sender.send(samples.report())
        assert sender.flush(10)
        assert 20.0 < sender.hold <= 30.0


def test_the_buffer_is_bounded_while_the_learner_is_away(caplog):
    config = loopback()
    store = Store()
    with open_client_session(config) as client, ExperienceSender(client, "run", "desk-0", buffer=20) as sender:
        assert all(sender.send(samples.report(), timeout=0) for _ in range(20))
        assert not sender.send(samples.report(), timeout=0.1)
        assert not sender.send(samples.report(), timeout=0)
        assert sender.pending == 20
        assert not sender.learner_present
        assert caplog.text.count("the buffer is full") == 1
        blocked = threading.Thread(target=sender.send, args=(samples.report(),))
        blocked.start()
        with open_learner_session(config) as learner, ExperienceServer(learner, "run", 5, store):
            assert sender.flush(10)
            blocked.join(5)
            assert not blocked.is_alive()
            assert sender.flush(10)
        assert sorted(store.sequences) == list(range(21))


def test_closing_gives_up_at_once_and_says_so(caplog):
    with open_client_session(loopback()) as client:
        sender = ExperienceSender(client, "run", "desk-0", buffer=1)
        sender.send(samples.report())
        blocked = threading.Thread(target=sender.send, args=(samples.report(),))
        blocked.start()
        sender.close()
        sender.close()
        blocked.join(5)
        assert not blocked.is_alive()
        assert not sender.send(samples.report())
        assert not sender.flush(5)
    assert "closed with 1 messages" in caplog.text


def test_a_session_that_closes_first_ends_delivery():
    client = open_client_session(loopback())
    with ExperienceSender(client, "run", "desk-0") as sender:
        client.close()
        with contextlib.suppress(zenoh.ZError):
            sender.send(samples.report())
        assert not sender.flush(5)


def test_no_more_than_the_window_is_ahead_of_the_oldest(sessions):
    """A learner that never acknowledges the first message sees only the window."""
    learner, client = sessions
    came = set()

    def answer(query):
        with query:
            delivery = decode(query.payload.to_bytes(), Delivery)
            came.add(delivery.sequence)
            ack = Ack(delivery.sequence, delivery.sequence != 1, 0.0, "", 5)
            query.reply(query.key_expr, encode(ack))

    queryable = learner.declare_queryable("hd/run/experience/*", zenoh.handlers.Callback(answer, indirect=False))
    with ExperienceSender(client, "run", "desk-0", window=4) as sender:
        for _ in range(20):
            sender.send(samples.report())
        assert eventually(lambda: sender.acknowledged == 4)
        time.sleep(0.3)
        assert came == {0, 1, 2, 3, 4}
    queryable.undeclare()


def test_clients_beyond_the_limit_are_turned_away_and_come_back(sessions):
    """More waits than the learner takes: the others go unanswered and are sent again, nothing is lost."""
    learner, client = sessions
    store, gate = Store(), threading.Event()

    def slow(delivery, payload):
        gate.wait(10)
        return store(delivery, payload)

    with ExperienceServer(learner, "run", 5, slow, max_waiting=2) as server:
        with contextlib.ExitStack() as stack:
            senders = [stack.enter_context(ExperienceSender(client, "run", f"desk-{i}")) for i in range(6)]
            for sender in senders:
                sender.send(samples.report())
            assert eventually(lambda: server._server.turned_away > 0)
            gate.set()
            assert all(sender.flush(10) for sender in senders)
        assert sorted(d.actor for d in store.deliveries) == [f"desk-{i}" for i in range(6)]


def test_a_host_that_floods_the_learner_waits_behind_itself(sessions):
    learner, client = sessions
    stored, gate = [], threading.Event()

    def slow(delivery, payload):
        gate.wait(10)
        stored.append(delivery.actor)
        return 0.0

    def unheard(reply):
        pass

    with ExperienceServer(learner, "run", 5, slow, max_waiting=64) as server:
        for number in range(100):
            name = f"evil-{number % 10}"
            flood = encode(Delivery(name, 7, number, samples.report()))
            client.get(f"hd/run/experience/{name}", zenoh.handlers.Callback(unheard, indirect=False), payload=flood)
        assert eventually(lambda: server._server.turned_away >= 35)
        with ExperienceSender(client, "run", "desk-0") as sender, ExperienceSender(client, "run", "lab-0") as other:
            for each in (sender, other):
                each.send(samples.report())
            assert eventually(lambda: {"desk", "lab"} <= server._server._waiting._sources.keys())
            gate.set()
            assert sender.flush(10) and other.flush(10)
    assert {"desk-0", "lab-0"} <= set(stored[:6])


def test_a_learner_that_takes_longer_than_the_timeout_is_waited_for(sessions):
    """What is sent again and again would wait behind itself, and no answer would ever come in time."""
    learner, client = sessions
    store = Store()

    def slow(delivery, payload):
        time.sleep(0.3)
        return store(delivery, payload)

    with (
        ExperienceServer(learner, "run", 5, slow),
        ExperienceSender(client, "run", "desk-0", ack_timeout=0.1) as sender,
    ):
        for _ in range(3):
            sender.send(samples.report())
        assert sender.flush(20)
