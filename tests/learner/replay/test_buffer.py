import dataclasses
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import ConfigError
from common.messages.experience import Chunk, Delivery, End
from common.messages.validation import check_observations
from common.observations.observation import MAX_DEGREE, MAX_VIEWPOINTS, Observation, ObservationBatch
from learner.replay.buffer import ReplayBuffer
from tests.learner.experience import deliver, episode_chunks, episode_report, observation_pool

POOL = observation_pool()


def same(a: Observation, b: Observation) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in Observation.__slots__)


def all_transitions(deliveries: list[Delivery]) -> dict[float, tuple[Observation, Observation, bool]]:
    """Reference: every (o, o', terminal) of complete chunks by the reward that names the step."""
    observations: dict[tuple, Observation] = {}
    steps = []
    for delivery in deliveries:
        chunk = delivery.body
        assert isinstance(chunk, Chunk)
        key = (delivery.actor, chunk.episode)
        for i in range(len(chunk.observations)):
            observations[(*key, chunk.first_step + i)] = chunk.observations[i]
        for i in range(chunk.steps):
            terminal = chunk.end is End.TERMINAL and i == chunk.steps - 1
            steps.append((float(chunk.rewards[i]), (*key, chunk.first_step + i), terminal))
    found = {}
    for reward, (actor, episode, step), terminal in steps:
        following = observations.get((actor, episode, step + 1))
        if following is not None:
            found[reward] = (observations[(actor, episode, step)], following, terminal)
    return found


def drawn(replay: ReplayBuffer, draws: int = 600) -> dict[float, tuple[Observation, Observation, bool]]:
    batch = replay.sample(draws, np.random.default_rng(0))
    assert batch.next_valid.all()
    return {
        float(batch.rewards[i]): (batch.observations[i], batch.next_observations[i], bool(batch.terminal[i]))
        for i in range(draws)
    }


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_transitions_are_the_same_in_whatever_order_chunks_arrive(data):
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    deliveries = []
    for episode in range(data.draw(st.integers(1, 4))):
        steps = data.draw(st.integers(1, 20))
        end = data.draw(st.sampled_from(list(End)))
        deliveries += deliver(
            episode_chunks(rng, POOL, steps, data.draw(st.integers(1, 6)), end, episode=episode),
            actor=f"desk-{episode % 2}",
        )
    expected = all_transitions(deliveries)
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    for delivery in data.draw(st.permutations(deliveries)):
        replay.add(delivery)
    assert len(replay) == len(expected)
    if expected:
        for reward, (o, following, terminal) in drawn(replay).items():
            assert same(o, expected[reward][0])
            assert same(following, expected[reward][1])
            assert terminal == expected[reward][2]


def test_images_come_back_with_their_observations():
    """From chunks larger than what a piece of images may be, and through a ring that goes round."""
    rng = np.random.default_rng(5)
    pool = observation_pool(5, (2, 6), 40, image=True)
    replay = ReplayBuffer(capacity=90, max_bytes=30_000_000, images=True)
    made = [
        deliver(episode_chunks(rng, pool, 50, 50, End.TERMINAL, episode=episode), actor=f"desk-{episode}")[0]
        for episode in range(5)
    ]
    for delivery in made:
        replay.add(delivery)
    expected = all_transitions(made)
    found = drawn(replay)
    assert {reward // 1000 for reward in found} == {3.0, 4.0}
    for reward, (o, following, _) in found.items():
        assert same(o, expected[reward][0]) and o.image is not None
        assert same(following, expected[reward][1])
    assert replay.bytes > 91 * 2 * 48 * 48


def test_a_missing_chunk_leaves_a_gap_until_it_arrives():
    chunks = deliver(episode_chunks(np.random.default_rng(1), POOL, 12, 4, End.TRUNCATED))
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    replay.add(chunks[0])
    replay.add(chunks[2])
    assert len(replay) == 3 + 4
    replay.add(chunks[1])
    assert len(replay) == 12
    assert not any(terminal for _, _, terminal in drawn(replay).values())


def test_the_dangling_step_of_a_dead_actor_serves_imitation_alone():
    chunks = deliver(episode_chunks(np.random.default_rng(2), POOL, 4, 4, End.NONE, labelled=True))
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    assert replay.add(chunks[0]) == 4
    assert len(replay) == 3
    assert replay.labelled == 4
    batch = replay.sample_labelled(200, np.random.default_rng(0))
    dangling = batch.rewards == 3.0
    assert dangling.any()
    assert not batch.next_valid[dangling].any()
    assert batch.next_valid[~dangling].all()
    assert same(batch.next_observations[int(np.flatnonzero(dangling)[0])], chunks[0].body.observations[3])


def test_labels_come_back_with_their_observation_in_mixed_batches():
    rng = np.random.default_rng(3)
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    labelled = episode_chunks(rng, POOL, 10, 10, End.TERMINAL, labelled=True, episode=1)
    replay.add(deliver(labelled)[0])
    replay.add(deliver(episode_chunks(rng, POOL, 10, 10, End.TERMINAL, episode=2), actor="b")[0])
    batch = replay.sample(300, rng)
    assert batch.labels is not None
    assert set(batch.rewards[batch.labelled] // 1000) == {1.0}
    assert set(batch.rewards[~batch.labelled] // 1000) == {2.0}
    expected = labelled[0]
    widths = [len(expected.observations[i].waypoint_nodes()) for i in range(10)]
    costs = np.split(expected.labels.cost, np.cumsum(widths)[:-1])
    at = 0
    for i in range(len(batch)):
        width = len(batch.observations[i].waypoint_nodes())
        found = batch.labels.cost[at : at + width]
        step = int(batch.rewards[i]) % 1000
        if batch.labelled[i]:
            assert np.array_equal(found, costs[step])
            assert batch.labels.beacon[i] == expected.labels.beacon[step]
        else:
            assert not found.any() and batch.labels.beacon[i] == -1
        at += width
    assert at == len(batch.labels.cost)


@pytest.mark.parametrize("steps", [1, 3])
def test_labelled_transitions_bring_the_labels_of_the_observation_that_they_lead_to(steps):
    rng = np.random.default_rng(4)
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    chunk = episode_chunks(rng, POOL, 10, 10, End.TERMINAL, labelled=True, episode=1)[0]
    replay.add(deliver([chunk])[0])
    replay.add(deliver(episode_chunks(rng, POOL, 10, 10, End.TERMINAL, episode=2), actor="b")[0])
    one = replay.sample(300, np.random.default_rng(6), labelled=True)
    batch = replay.sample(300, np.random.default_rng(6), labelled=True, steps=steps, gamma=1.0)
    assert batch.labelled.all() and set(one.rewards // 1000) == {1.0}
    assert batch.next_labels is not None
    widths = [len(chunk.observations[i].waypoint_nodes()) for i in range(10)]
    costs = np.split(chunk.labels.cost, np.cumsum(widths)[:-1])
    at = 0
    for i in range(len(batch)):
        step = int(one.rewards[i]) % 1000 + steps
        width = len(batch.next_observations[i].waypoint_nodes())
        found = batch.next_labels.cost[at : at + width]
        # The observation after the last step has no action, so no label either; nothing is bootstrapped from it.
        assert batch.next_labelled[i] == (step < 10)
        assert batch.next_labelled[i] or batch.terminal[i]
        assert np.array_equal(found, costs[step]) if step < 10 else not found.any()
        at += width
    assert at == len(batch.next_labels.cost)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(100, 140), st.booleans())
def test_the_oldest_leave_first_and_limits_hold(seed, capacity, reorder):
    rng = np.random.default_rng(seed)
    replay = ReplayBuffer(capacity=capacity, max_bytes=30_000_000)
    last = -1.0
    for episode in range(30):
        end = list(End)[rng.integers(3)]
        chunks = deliver(episode_chunks(rng, POOL, int(rng.integers(1, 30)), 5, end, episode=episode))
        if reorder:
            rng.shuffle(chunks)
        for chunk in chunks:
            replay.add(chunk)
            assert len(replay) <= capacity
            assert replay.bytes <= 30_000_000
            last = max(last, float(chunk.body.rewards.max()))
    found = drawn(replay, 3000)
    assert len(found) == len(replay)  # each is drawn when as many are drawn
    assert max(found) // 1000 >= last // 1000 - 1
    assert min(found) // 1000 > 0


def test_a_buffer_bounded_by_bytes_wraps_around_without_mixing_rows():
    large = observation_pool(seed=5, viewpoints=(600, 1200), size=8)
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(capacity=100_000, max_bytes=30_000_000)
    recent: dict[float, tuple[Observation, Observation, bool]] = {}
    for episode in range(150):
        chunks = deliver(episode_chunks(rng, large, 16, 16, End.TERMINAL, labelled=episode % 3 == 0, episode=episode))
        replay.add(chunks[0])
        assert replay.bytes <= 30_000_000
        if episode > 50:
            recent |= all_transitions(chunks)
    assert 500 < len(replay) < 2000
    assert replay.fill > 0.99
    for reward, (o, following, _) in drawn(replay, 300).items():
        assert same(o, recent[reward][0]) and same(following, recent[reward][1])


def test_an_observation_of_the_largest_size_fits_and_so_does_the_next():
    """20,000 viewpoints with 254 neighbours: as much as a message may bring, more than the rest of the buffer holds."""
    n = MAX_VIEWPOINTS
    half = MAX_DEGREE // 2
    degree = np.minimum(half, np.arange(n)[::-1]).astype(np.uint8)
    edges = int(degree.sum(dtype=np.int64))
    first = np.repeat(np.arange(n), degree)
    ends = np.cumsum(degree, dtype=np.int64)
    largest = dataclasses.replace(
        POOL[0],
        offsets=np.zeros((n, 2), np.int16),
        utility=np.arange(n, dtype=np.uint16),
        visited=np.zeros(n, np.bool_),
        beacon=np.arange(n) == 0,
        degree=degree,
        neighbours=(first + 1 + np.arange(edges) - np.repeat(ends - degree, degree)).astype(np.uint16),
        bent=np.arange(edges, dtype=np.uint32),
        bent_length=np.ones(edges, dtype=np.float32),
        robot=0,
        has_target=False,
        target_known=False,
        target_offset=np.zeros(2, np.float32),
        target_links=np.zeros(0, np.uint16),
    )
    check_observations(ObservationBatch.stack([largest]), "largest")
    replay = ReplayBuffer(capacity=100, max_bytes=30_000_000)
    chunks = deliver(episode_chunks(np.random.default_rng(0), [largest], 1, 1, End.NONE, labelled=True))
    for _ in range(3):
        for body in (chunks[0].body, *episode_chunks(np.random.default_rng(1), POOL, 8, 8, End.TERMINAL, episode=1)):
            replay.add(deliver([body])[0])
            assert replay.bytes <= 30_000_000
    # Each largest one drove out the one before it and what was older; the last two episodes are here.
    assert len(replay) == 16
    assert replay.labelled == 1


def test_the_same_deliveries_and_seed_give_the_same_samples_from_any_start():
    """What a resumed learner rebuilds from a later start of the journal samples like the original."""
    rng = np.random.default_rng(4)
    deliveries = []
    for episode in range(30):
        deliveries += deliver(episode_chunks(rng, POOL, 12, 4, End.TERMINAL, episode=episode))
    whole, rebuilt = ReplayBuffer(100, 30_000_000), ReplayBuffer(100, 30_000_000)
    for delivery in deliveries:
        whole.add(delivery)
    for delivery in deliveries[30:]:
        rebuilt.add(delivery)
    one = whole.sample(64, np.random.default_rng(9))
    other = rebuilt.sample(64, np.random.default_rng(9))
    assert np.array_equal(one.rewards, other.rewards)
    assert np.array_equal(one.observations.neighbours, other.observations.neighbours)


def test_a_confused_actor_that_repeats_steps_does_no_harm():
    rng = np.random.default_rng(8)
    replay = ReplayBuffer(capacity=100, max_bytes=30_000_000)
    for sequence in range(200):
        first, second = episode_chunks(rng, POOL, 8, 4, End.NONE)
        replay.add(Delivery("a", 1, 2 * sequence, second if sequence % 3 else first))
        replay.add(Delivery("a", 1, 2 * sequence + 1, second))
        assert 0 < len(replay) <= 100
    assert replay.sample(64, rng).next_valid.all()


def test_reports_are_no_experience_and_an_empty_buffer_says_so():
    replay = ReplayBuffer(capacity=100, max_bytes=30_000_000)
    assert replay.add(deliver([episode_report()])[0]) == 0
    assert len(replay) == 0
    with pytest.raises(ValueError, match="no transition yet"):
        replay.sample(4, np.random.default_rng(0))
    with pytest.raises(ValueError, match="no labelled step yet"):
        replay.sample_labelled(4, np.random.default_rng(0))


def test_too_little_memory_is_refused_with_advice():
    with pytest.raises(ConfigError, match=r"max_bytes.*30,000,000 or more"):
        ReplayBuffer(capacity=100, max_bytes=20_000_000)


def test_adding_and_sampling_from_threads_never_mixes_observations():
    rng = np.random.default_rng(6)
    episodes = [deliver(episode_chunks(rng, POOL, 20, 5, End.TERMINAL, episode=e)) for e in range(60)]
    expected = all_transitions([delivery for chunks in episodes for delivery in chunks])
    replay = ReplayBuffer(capacity=150, max_bytes=30_000_000)
    for chunk in episodes[0]:
        replay.add(chunk)

    def write():
        for chunks in episodes[1:]:
            for chunk in chunks:
                replay.add(chunk)

    writer = threading.Thread(target=write)
    writer.start()
    while writer.is_alive():
        for reward, (o, following, _) in drawn(replay, 16).items():
            assert same(o, expected[reward][0]) and same(following, expected[reward][1])
    writer.join()


def test_several_steps_sum_up_to_the_end_of_the_episode():
    chunks = deliver(episode_chunks(np.random.default_rng(3), POOL, 7, 3, End.TERMINAL))
    rewards = np.concatenate([delivery.body.rewards for delivery in chunks])
    last = chunks[-1].body.observations
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    for delivery in chunks:
        replay.add(delivery)
    firsts = {float(np.float32(r)): i for i, r in enumerate(rewards)}
    ones = replay.sample(200, np.random.default_rng(5))
    batch = replay.sample(200, np.random.default_rng(5), steps=3, gamma=0.5)
    for i in range(200):
        step = firsts[float(ones.rewards[i])]
        taken = rewards[step : step + 3]
        assert batch.rewards[i] == pytest.approx(sum(0.5**m * r for m, r in enumerate(taken)), rel=1e-5)
        assert batch.discounts[i] == pytest.approx(0.5 ** len(taken))
        assert batch.terminal[i] == (step + 3 >= 7)
        if batch.terminal[i]:
            assert same(batch.next_observations[i], last[len(last) - 1])


def test_several_steps_stop_at_a_gap():
    chunks = deliver(episode_chunks(np.random.default_rng(4), POOL, 12, 4, End.TRUNCATED))
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    replay.add(chunks[0])
    batch = replay.sample(100, np.random.default_rng(0), steps=5, gamma=0.5)
    # Of the four steps here three have a successor: they sum one, two or three rewards.
    assert set(batch.discounts.tolist()) == {0.5, 0.25, 0.125}
    assert not batch.terminal.any()


def test_the_newest_transitions_are_those_that_arrived_last():
    rng = np.random.default_rng(8)
    replay = ReplayBuffer(capacity=30, max_bytes=30_000_000)
    for episode in range(9):  # the ring has turned: the newest lie before older ones in memory
        replay.add(deliver(episode_chunks(rng, POOL, 10, 10, End.TERMINAL, labelled=True, episode=episode))[0])
    batch = replay.sample(300, rng, labelled=True, newest=13)
    assert set(batch.rewards.tolist()) == {7007.0, 7008.0, 7009.0, *(8000.0 + np.arange(10))}
    assert len(set(replay.sample(300, rng, newest=1000).rewards.tolist())) == 30


def test_rehearsed_steps_come_last_from_the_whole_buffer_and_count_as_nobodys_choice():
    rng = np.random.default_rng(9)
    replay = ReplayBuffer(capacity=1000, max_bytes=30_000_000)
    chunks = [episode_chunks(rng, POOL, 10, 10, End.TERMINAL, labelled=True, episode=i)[0] for i in range(4)]
    for chunk in chunks:
        replay.add(deliver([chunk])[0])
    batch = replay.sample(300, rng, steps=2, labelled=True, newest=10, rehearsed=100)
    ones = replay.sample(300, np.random.default_rng(1), labelled=True)
    assert set(batch.families[:200].tolist()) == {0} and set(batch.families[200:].tolist()) == {0, 1, 2}
    assert (batch.probabilities[:200] > 0.0).all() and not batch.probabilities[200:].any()
    assert batch.labelled.all() and batch.labels is not None
    step = ones.rewards.astype(int) % 1000
    episode = ones.rewards.astype(int) // 1000
    for name in ("remaining", "unseen"):
        told = np.array([getattr(chunks[e].labels, name)[s] for e, s in zip(episode, step, strict=True)])
        assert np.array_equal(getattr(ones.labels, name), told)
    chances = np.array([chunks[e].probabilities[s] for e, s in zip(episode, step, strict=True)])
    assert np.array_equal(ones.probabilities, chances)
