import numpy as np
import pytest

from common.bus.liveness import declare_presence
from common.bus.session import open_client_session, open_learner_session
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.messages.schema import encode
from tests.common.bus.processes import eventually, loopback
from tests.common.messages import samples


@pytest.fixture
def sessions():
    config = loopback()
    with open_learner_session(config) as learner, open_client_session(config) as client:
        yield learner, client


def version_of(puller):
    weights = puller.latest()
    return -1 if weights is None else weights.version


def test_a_late_joiner_has_the_weights_at_once_and_follows(sessions):
    learner, client = sessions
    with WeightsPublisher(learner, "run") as publisher:
        publisher.publish(samples.weights(version=4))
        with WeightsPuller(client, "run", timer=60) as puller:
            first = puller.wait(5)
            assert first.version == 4
            np.testing.assert_array_equal(first.tensors["encoder.weight"], np.full((8, 4), 0.5, np.float32))
            publisher.publish(samples.weights(version=5))
            assert puller.wait(5, after=first).version == 5
            assert puller.age < 60


def test_an_early_joiner_waits(sessions):
    learner, client = sessions
    with WeightsPuller(client, "run", timer=60) as puller:
        assert puller.latest() is None
        assert puller.age == 0.0
        assert puller.wait(0.2) is None
        with WeightsPublisher(learner, "run") as publisher:
            publisher.publish(samples.weights(version=1))
            assert puller.wait(5).version == 1


def test_lost_notices_are_made_up_for_by_the_timer(sessions):
    learner, client = sessions
    with WeightsPublisher(learner, "run") as publisher, WeightsPuller(client, "run", timer=0.2) as puller:
        publisher.publish(samples.weights(version=1))
        assert puller.wait(5)
        # Replace the version behind the back of the notice.
        publisher._newest = publisher._averaged = (
            encode(samples.weights(version=2)),
            samples.weights(version=2).notice(),
        )
        assert eventually(lambda: version_of(puller) == 2)


def test_evaluators_get_the_average_when_there_is_one(sessions):
    learner, client = sessions
    with WeightsPublisher(learner, "run") as publisher:
        publisher.publish(samples.weights(version=1))
        with WeightsPuller(client, "run", averaged=True) as puller, WeightsPuller(client, "run") as plain:
            first = puller.wait(5)
            assert not first.averaged
            publisher.publish(
                samples.weights(version=2), averaged=samples.weights(version=2, value=0.25, averaged=True)
            )
            second = puller.wait(5, after=first)
            assert second.averaged
            assert second.tensors["encoder.weight"][0, 0] == 0.25
            assert eventually(lambda: version_of(plain) == 2)
            assert not plain.latest().averaged


def test_the_arrays_may_change_after_publishing(sessions):
    learner, client = sessions
    weights = samples.weights(version=1)
    with WeightsPublisher(learner, "run") as publisher:
        publisher.publish(weights)
        weights.tensors["encoder.weight"][:] = 9.0
        with WeightsPuller(client, "run") as puller:
            assert puller.wait(5).tensors["encoder.weight"][0, 0] == 0.5


def test_unusable_weights_are_refused_and_the_last_good_ones_stay(sessions, caplog):
    learner, client = sessions
    shapes = {"encoder.weight": (8, 4), "encoder.bias": (8,)}
    with WeightsPublisher(learner, "run") as publisher:
        publisher.publish(samples.weights(version=1))
        with WeightsPuller(client, "run", shapes=shapes) as puller:
            assert puller.wait(5)
            for version, tensors in enumerate(
                [
                    {"encoder.weight": np.zeros((4, 8), np.float32), "encoder.bias": np.zeros(8, np.float32)},
                    {"encoder.weight": np.zeros((8, 4), np.float32)},
                    {**samples.weights().tensors, "extra": np.zeros(1, np.float32)},
                    {**samples.weights().tensors, "encoder.bias": np.full(8, np.nan, np.float32)},
                ],
                start=2,
            ):
                wrong = samples.Weights.of(tensors, learner=11, version=version, updates=1)
                publisher.publish(wrong)
                assert eventually(lambda expected=version: puller.refused == expected - 1)
            assert version_of(puller) == 1
            assert "keeping version 1" in caplog.text
            publisher.publish(samples.weights(version=9))
            assert eventually(lambda: version_of(puller) == 9)


def test_a_restarted_learner_wins_even_with_a_lower_version():
    config = loopback()
    with open_client_session(config) as client, WeightsPuller(client, "run", timer=60) as puller:
        with open_learner_session(config) as learner, WeightsPublisher(learner, "run") as publisher:
            publisher.publish(samples.weights(version=50, learner=1))
            before = puller.wait(5)
        with open_learner_session(config) as learner, WeightsPublisher(learner, "run") as publisher:
            publisher.publish(samples.weights(version=40, learner=2))
            # The notice may have been sent before the actor was back: its presence makes actors pull.
            with declare_presence(learner, "run", "learner", "learner"):
                after = puller.wait(10, after=before)
            assert (after.version, after.learner) == (40, 2)


def test_an_older_version_never_replaces_a_newer_one(sessions):
    learner, client = sessions
    with WeightsPublisher(learner, "run") as publisher, WeightsPuller(client, "run", timer=0.1) as puller:
        publisher.publish(samples.weights(version=5))
        assert puller.wait(5)
        publisher.publish(samples.weights(version=4))
        assert puller.wait(0.5, after=puller.latest()) is None
        assert version_of(puller) == 5
