"""Two learners of one run whose networks are joined after both have begun."""

import contextlib
import threading
import time

from common.bus.experience import ExperienceSender
from common.bus.liveness import declare_presence
from common.bus.session import new_incarnation, open_client_session, open_learner_session
from common.config import BusConfig
from learner.loop import train
from learner.process import Link
from learner.report import Reporter
from learner.rivals import Rivals
from learner.run.folder import RunFolder
from tests.common.bus.processes import eventually, loopback
from tests.learner.runs import episodes, make_trainer, small_config


@contextlib.contextmanager
def learner(folder):
    """A learner on a network of its own; gives its trainer and its endpoint."""
    bus = loopback()
    with (
        RunFolder.create(folder, small_config()) as run,
        open_learner_session(bus) as session,
        contextlib.ExitStack() as stack,
    ):
        trainer, _ = make_trainer(run)
        stack.callback(trainer.close)
        trainer.begin()
        stack.enter_context(Link(session, trainer, new_incarnation(), Reporter(trainer, "cpu", bus.listen)))
        loop = threading.Thread(target=train, args=(trainer,))
        loop.start()
        stack.callback(loop.join)
        stack.callback(trainer.stop)
        yield trainer, bus.listen


def deliver(endpoint, actor, count, seed):
    with open_client_session(BusConfig(listen=endpoint)) as session, ExperienceSender(session, "test", actor) as sender:
        for delivery in episodes(count, seed):
            sender.send(delivery.body)
        assert sender.flush(30.0)


def test_the_later_one_holds_until_the_other_is_gone(tmp_path, caplog):
    caplog.set_level("INFO")
    with learner(tmp_path / "first") as (first, there):
        with learner(tmp_path / "second") as (second, here):
            assert not first.readiness.held and not second.readiness.held
            with (
                open_learner_session(loopback(connect=(here, there))) as between,
                declare_presence(between, "test", "actor", "desk-1"),
            ):
                assert eventually(lambda: second.readiness.held, 20.0)
                # Versions wait for whoever fetches them.
                assert eventually(lambda: first.receivers == 1, 20.0)
                assert (second.state, first.readiness.held) == ("held", False)
                assert "This one began later, so it holds and takes nothing" in caplog.text
                assert "It began later, so it has to hold" in caplog.text
                updates = second.limiter.updates
                deliver(here, "desk-0", 4, 0)
                assert (second.limiter.steps, first.limiter.steps) == (0, 32)
                assert second.limiter.updates == updates
            assert eventually(lambda: not second.readiness.held, 20.0)
            assert ": continuing" in caplog.text
            deliver(here, "desk-1", 3, 1)
            assert second.limiter.steps == 24
        assert not first.readiness.held


def test_of_several_exactly_one_goes_on():
    names = {}
    with contextlib.ExitStack() as stack:
        session = stack.enter_context(open_learner_session(loopback()))
        now = time.time()
        for number, began in enumerate((now, now - 3.0, now - 3.0)):
            names[number] = stack.enter_context(Rivals(session, "test", 100 + number, began))
        present = [("learner", "learner"), *(("learner", each._name) for each in names.values()), ("actor", "desk-0")]
        assert [each.earlier(present) for each in names.values()] == [True, False, True]
