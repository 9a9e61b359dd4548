import numpy as np
import pytest

from actors.driver import ExpertDriver, PolicyDriver, RandomDriver
from actors.episode import Role, run_episode
from actors.transition_recorder import TransitionRecorder
from common.config import NetworkConfig
from common.messages.experience import Delivery, End, ObservationBatch
from common.messages.schema import decode, encode
from common.policies.policy import Policy
from tests.actors.test_environment import BRANCHES, CORRIDOR, ROOM, environment

ROLE = Role("train", "grid")


class Watcher(RandomDriver):
    """Chooses by chance and remembers what it saw and chose."""

    def __init__(self, seed):
        super().__init__(np.random.default_rng(seed))
        self.seen, self.chosen = [], []

    def choose(self, observation, environment):
        choice = super().choose(observation, environment)
        self.seen.append(observation)
        self.chosen.append(choice)
        return choice


def record(task="exploration", chunk_steps=4, seed=0, label=True, **options):
    chunks = []
    driver = Watcher(seed)
    recorder = TransitionRecorder(chunk_steps, chunks.append)
    env = environment(task, **options)
    report = run_episode(env, BRANCHES, driver, ROLE, seed=0, recorder=recorder, label=label)
    return chunks, driver, report, env


@pytest.mark.parametrize("task", ["exploration", "navigation"])
@pytest.mark.parametrize("chunk_steps", [1, 4, 64])
def test_chunks_hold_the_episode_exactly(task, chunk_steps):
    chunks, driver, report, env = record(task, chunk_steps, max_steps=10)
    assert sum(chunk.steps for chunk in chunks) == report.steps == len(driver.seen)
    assert [chunk.first_step for chunk in chunks] == [i * chunk_steps for i in range(len(chunks))]
    assert [chunk.end for chunk in chunks[:-1]] == [End.NONE] * (len(chunks) - 1)
    assert chunks[-1].end is env.end
    observations = [chunk.observations[i] for chunk in chunks for i in range(chunk.steps)]
    for recorded, seen in zip(observations, driver.seen, strict=True):
        for name in (
            "offsets",
            "utility",
            "visited",
            "beacon",
            "degree",
            "neighbours",
            "target_links",
            "target_offset",
        ):
            assert np.array_equal(getattr(recorded, name), getattr(seen, name))
    assert len(chunks[-1].observations) == chunks[-1].steps + 1
    choices = [(int(b), int(a)) for chunk in chunks for b, a in zip(chunk.beacons, chunk.waypoints, strict=True)]
    assert choices == [(choice.beacon, choice.waypoint) for choice in driver.chosen]
    assert sum(float(chunk.rewards.sum()) for chunk in chunks) == pytest.approx(report.reward, abs=1e-4)


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_chunks_pass_the_checks_of_the_wire(task):
    for seed in range(3):
        chunks, *_ = record(task, seed=seed, max_steps=12)
        for sequence, chunk in enumerate(chunks):
            delivery = decode(encode(Delivery("desk-0", 5, sequence, chunk)), Delivery)
            assert delivery.body.steps == chunk.steps
            assert np.array_equal(delivery.body.labels.cost, chunk.labels.cost)


def test_labels_price_every_waypoint():
    chunks, *_ = record(max_steps=10)
    for chunk in chunks:
        counts = [len(chunk.observations[i].waypoint_nodes()) for i in range(chunk.steps)]
        assert len(chunk.labels.cost) == sum(counts)
        bounds = np.cumsum([0, *counts])
        for i in range(chunk.steps):
            cost = chunk.labels.cost[bounds[i] : bounds[i + 1]]
            assert cost.min() == 0.0
            assert np.isfinite(cost).all()
            beacon = chunk.labels.beacon[i]
            assert beacon == -1 or beacon in chunk.observations[i].beacon_nodes()


def test_without_labels_there_are_none():
    chunks, *_ = record(label=False, max_steps=6)
    assert all(chunk.labels is None for chunk in chunks)


def test_an_episode_without_decisions_sends_no_chunk():
    chunks = []
    recorder = TransitionRecorder(4, chunks.append)
    report = run_episode(environment(), ROOM, ExpertDriver(), ROLE, seed=0, recorder=recorder)
    assert report.steps == 0
    assert chunks == []


def test_a_broken_off_episode_keeps_what_was_collected():
    chunks = []
    recorder = TransitionRecorder(4, chunks.append)
    left = iter([True] * 6 + [False])
    report = run_episode(
        environment(), CORRIDOR, ExpertDriver(), ROLE, seed=0, recorder=recorder, keep_on=lambda: next(left)
    )
    assert report is None
    assert [chunk.steps for chunk in chunks] == [4, 2]
    assert chunks[-1].end is End.NONE
    assert isinstance(chunks[-1].observations, ObservationBatch)
    assert len(chunks[-1].observations) == 2
    run_episode(environment(), CORRIDOR, ExpertDriver(), ROLE, seed=0, recorder=recorder)
    assert [chunk.episode for chunk in chunks][:3] == [0, 0, 1]


def test_drawn_waypoints_carry_their_probability_and_others_none():
    policy = Policy.from_config(NetworkConfig(width=16, heads=2, layers=1))
    chunks = []
    recorder = TransitionRecorder(64, chunks.append)
    drawing = PolicyDriver(policy, np.random.default_rng(3))
    for driver in (drawing, ExpertDriver(), PolicyDriver(policy, np.random.default_rng(3), greedy=True)):
        env = environment(max_steps=5)
        run_episode(env, BRANCHES, driver, ROLE, seed=0, recorder=recorder, label=True, family=len(chunks))
    drawn, *others = chunks
    for i in range(drawn.steps):
        decision = policy.decide(drawn.observations[i], greedy=True, rng=np.random.default_rng(0))
        chance = dict(zip(drawn.observations[i].waypoint_nodes(), decision.waypoint_probabilities, strict=True))
        assert drawn.probabilities[i] == pytest.approx(chance[drawn.waypoints[i]], abs=1e-6)
    assert not any(chunk.probabilities.any() for chunk in others)
    assert [chunk.family for chunk in chunks] == [0, 1, 2]


@pytest.mark.parametrize("task", ["exploration", "navigation"])
def test_labels_tell_what_remains_and_what_is_unseen(task):
    chunks, _, _, env = record(task, max_steps=12)
    remaining = np.concatenate([chunk.labels.remaining for chunk in chunks])
    unseen = np.concatenate([chunk.labels.unseen for chunk in chunks])
    assert (remaining > 0.0).all()
    if task == "navigation":
        assert not unseen.any()
    else:
        assert (np.diff(unseen) <= 0.0).all()
        assert unseen[0] > env.coverage.unseen_area
