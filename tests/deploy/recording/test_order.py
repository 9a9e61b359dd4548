"""Recordings whose messages do not lie in the order of their times."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from deploy.recording.order import FileOrder
from deploy.recording.reader import read_bag
from tests.deploy.recording import world
from tests.deploy.recording.world import ODOMETRY, SCAN, STRING, recorded, status

WANTED = ("/odom", "/scan", "/hd/status")


def messages():
    """Half a minute of three topics, every payload another."""
    kinds = (("/odom", ODOMETRY, 0.02), ("/scan", SCAN, 0.1), ("/hd/status", STRING, 0.5))
    every = [
        replace(recorded(topic, STRING, step * period + 0.001 * number, status(f"{topic} {step}")), kind=kind)
        for number, (topic, kind, period) in enumerate(kinds)
        for step in range(round(30.0 / period))
    ]
    return sorted(every, key=lambda one: one.time)


def read(path):
    order = FileOrder()
    assert list(order.learning(read_bag(path))) == list(read_bag(path))
    return list(order.read(path, WANTED))


def one_topic_after_the_other(sent):
    return sorted(sent, key=lambda one: (one.topic, one.time))


def threads_that_overtake_each_other(sent):
    late = np.random.default_rng(1).uniform(0.0, 0.5, len(sent))
    return [sent[k] for k in np.argsort([one.time * 1e-9 + by for one, by in zip(sent, late, strict=True)])]


def both(sent):
    return sorted(threads_that_overtake_each_other(sent), key=lambda one: one.topic)


@pytest.mark.parametrize("mixed", [one_topic_after_the_other, threads_that_overtake_each_other, both])
def test_messages_come_in_the_order_of_their_times(tmp_path, mixed, caplog):
    sent = messages()
    path = world.write(tmp_path / "bag", mixed(sent))
    assert read(path) == sent
    assert ("messages do not lie in the order" in caplog.text) == (mixed is not threads_that_overtake_each_other)


def test_a_sound_recording_is_left_as_it_is(tmp_path, caplog):
    caplog.set_level(logging.WARNING)
    sent = messages()
    assert read(world.write(tmp_path / "bag", sent)) == sent
    assert not caplog.records


@pytest.mark.parametrize("step", [-20.0, -3.0, -0.5])
def test_a_clock_that_was_set_back_is_no_disorder(tmp_path, step):
    sent = messages()
    half = len(sent) // 2
    torn = [*sent[:half], *(replace(one, time=one.time + round(step * 1e9)) for one in sent[half:])]
    assert read(world.write(tmp_path / "bag", torn)) == torn


def test_topics_that_nobody_wants_cost_nothing(tmp_path):
    sent = messages()
    path = world.write(tmp_path / "bag", one_topic_after_the_other(sent))
    order = FileOrder()
    list(order.learning(read_bag(path)))
    assert list(order.read(path, ["/scan", "/nowhere"])) == [one for one in sent if one.topic == "/scan"]
