import numpy as np
import pytest

from common.bus.keys import Keys
from common.bus.session import open_client_session, open_learner_session, open_viewer_session
from common.bus.views import MAX_LOOKED_AT, ViewPublisher, ViewWatcher
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples
from tests.common.messages.test_schema import equal

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def sessions():
    bus = loopback()
    with open_learner_session(bus), open_client_session(bus) as actor:
        yield actor, lambda: open_viewer_session(bus)


def test_an_evaluator_knows_whether_somebody_looks_and_is_seen_by_them(sessions):
    actor, page = sessions
    with ViewPublisher(actor, "run", "evaluator", "desk-0") as publisher:
        assert not publisher.looked_at
        with ViewWatcher(page(), "run") as watcher:
            assert eventually(lambda: publisher.outcomes_wanted)
            assert not publisher.looked_at
            watcher.look_at({("evaluator", "desk-1")})
            watcher.look_at({("evaluator", "desk-0")})
            assert eventually(lambda: publisher.looked_at)
            sent = [samples.view(RNG) for _ in range(3)]
            for view in sent:
                publisher.send(view)
            publisher.send(sent[0], outcome=True)
            seen = {}
            assert eventually(lambda: seen.update(watcher.views()) or equal(seen.get(("evaluator", "desk-0")), sent[2]))
            ended = []
            assert eventually(lambda: ended.extend(watcher.outcomes()) or len(ended) == 1)
            assert equal(ended[0], sent[0])
            watcher.look_at(())
            assert eventually(lambda: not publisher.looked_at)
        assert eventually(lambda: not publisher.outcomes_wanted)


def test_what_is_no_view_of_its_sender_is_counted_and_left_out(sessions):
    actor, page = sessions
    with ViewWatcher(page(), "other") as watcher, ViewPublisher(actor, "other", "evaluator", "rack-0") as publisher:
        watcher.look_at({("evaluator", "rack-0"), *(("actor", f"desk-{i}") for i in range(2 * MAX_LOOKED_AT))})
        assert eventually(lambda: publisher.outcomes_wanted)
        publisher.send(samples.view(RNG), outcome=True)
        actor.put(Keys("other").outcome("evaluator", "rack-0"), b"nonsense")
        actor.put(Keys("other").outcome("evaluator", "rack-0"), bytes(2 << 20))
        taken = []
        assert eventually(lambda: taken.extend(watcher.outcomes()) or watcher.invalid == 3)
        assert taken == []
        assert not publisher.looked_at, "eight at a time"
