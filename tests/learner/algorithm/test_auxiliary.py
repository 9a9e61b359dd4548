"""Hints of the true map: the actor tells them, symmetries turn them, and the network learns to foresee them."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from actors.driver import ExpertDriver
from actors.environment import Environment
from actors.episode import Role, run_episode
from actors.expert import make_expert
from actors.simulators.grid import GridSimulator
from actors.tasks import make_goal
from actors.transition_recorder import TransitionRecorder
from common.config import RewardConfig, RunConfig, SimulatorConfig, TaskConfig
from common.errors import MessageError
from common.messages.codec import pack, unpack
from common.messages.experience import Chunk, Delivery
from common.messages.schema import decode, encode
from common.network.graph_arrays import GraphArrays
from learner.algorithm.augment import SYMMETRIES, transform_transitions
from learner.algorithm.auxiliary import Hints
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.factory import make_learner
from learner.algorithm.sac import SacLearner
from learner.replay.buffer import ReplayBuffer
from tests.actors.test_environment import BRANCHES, MAPPING

CPU = torch.device("cpu")
CONFIG = RunConfig.model_validate(
    {
        "network": {"width": 32, "heads": 4, "layers": 1, "belief_map": True, "graph": "reduced"},
        "cloning": {"updates": 100, "auxiliary_weight": 0.5, "learning_rate": 5e-3},
        "learner": {"total_updates": 100},
    }
)


@functools.cache
def episode() -> tuple[Chunk, ...]:
    """Let the expert explore a small world."""
    task, chunks = TaskConfig(unseen_area=1.0), []
    environment = Environment(
        GridSimulator(SimulatorConfig(name="grid", rays=180), MAPPING.sensor_range),
        MAPPING,
        make_goal(task),
        RewardConfig(),
        64,
        make_expert(task, MAPPING, hints=True),
        images="spacing",
    )
    recorder = TransitionRecorder(8, chunks.append)
    run_episode(environment, BRANCHES, ExpertDriver(), Role("train", "grid"), seed=0, recorder=recorder, label=True)
    return tuple(chunks)


def drawn(count: int = 32, labelled_after: bool = False) -> TransitionBatch:
    replay = ReplayBuffer(1000, 30_000_000, images=True, hints=True)
    for number, chunk in enumerate(episode()):
        replay.add(decode(encode(Delivery("desk-0", 1, number, chunk)), Delivery))
    rng = np.random.default_rng(0)
    return replay.sample(count, rng, labelled=True) if labelled_after else replay.sample_labelled(count, rng)


def test_hints_tell_the_truth_about_what_is_unknown() -> None:
    batch = drawn()
    image, labels = batch.observations.image, batch.labels
    assert image is not None and labels is not None and labels.truth is not None and labels.gain is not None
    assert np.all(labels.truth >> 4 >= image >> 4), "what is known to be free is truly free"
    assert np.all((labels.truth & 15) >= (image & 15)), "and what is known to be a wall is one"
    assert (labels.truth >> 4).sum() > (image >> 4).sum()
    known = labels.gain >= 0.0
    assert known.mean() > 0.9
    assert labels.gain[known & (batch.observations.utility > 0)].max() > 0.02, "a door to a room shows the room"
    robots = np.cumsum(batch.observations.count) - batch.observations.count + batch.observations.robot
    assert labels.gain[robots].max() < 0.02, "where the robot stands it sees nothing new"


def test_turning_the_world_turns_the_hints() -> None:
    batch = drawn(8)
    expected = None
    for symmetry in range(SYMMETRIES):
        turned = transform_transitions(batch, np.full(8, symmetry))
        assert turned.labels is not None
        arrays = GraphArrays.from_observations(turned.observations, CONFIG.network)
        hints = Hints.of(turned.observations, turned.labels, turned.labelled, arrays, CPU)
        assert hints is not None and hints.asked.any()
        told = (hints.free[hints.asked].sum().item(), int(hints.asked.sum()), hints.gain.tolist())
        expected = expected or told
        assert told[0] == pytest.approx(expected[0], rel=1e-5)
        assert told[1:] == expected[1:]


def test_the_network_learns_to_foresee() -> None:
    learner = SacLearner(CONFIG, CPU)
    batch = drawn()
    figures = [learner.update(batch) for _ in range(20)]
    for name in ("auxiliary/free_space", "auxiliary/gain"):
        assert figures[-1][name] < 0.75 * figures[0][name], name
    assert figures[-1]["loss/cloning"] < figures[0]["loss/cloning"]
    other = SacLearner(CONFIG, CPU)
    other.restore(*learner.state())
    assert other.update(batch) == learner.update(batch), "heads and their moments are resumed too"


@pytest.mark.parametrize(
    "settings",
    [
        {"algorithm": "sac", "cloning": {"updates": 1, "auxiliary_weight": 5.0, "anchor_weight": 1.0}},
        {
            "algorithm": "ppo",
            "cloning": {"updates": 1, "auxiliary_weight": 5.0},
            "ppo": {"imitation_weight": 1.0, "value_only_updates": 0},
        },
    ],
    ids=["sac", "ppo"],
)
def test_it_goes_on_learning_that_in_reinforcement(settings: dict[str, object]) -> None:
    rest = {"reward": {"kind": "potential"}, "adam": {"policy": 5e-3}, "learner": {"total_updates": 100}}
    config = RunConfig.model_validate({"network": CONFIG.network.model_dump(), **rest, **settings})
    learner = make_learner(config, CPU)
    batch = drawn(16, labelled_after=True)
    learner.update(batch)
    figures = [learner.update(batch) for _ in range(8)]
    free = [each["auxiliary/free_space"] for each in figures]
    assert all("auxiliary/gain" in each for each in figures)
    assert free[-1] < 0.8 * free[0]


def test_hints_come_whole_or_not_at_all() -> None:
    fields = unpack(encode(Delivery("desk-0", 1, 0, episode()[0])), max_bytes=1 << 26)
    labels = fields["body"]["labels"]
    for name, wrong in (("gain", labels["gain"][1:]), ("gain", labels["gain"] + 100.0), ("truth", labels["truth"][1:])):
        with pytest.raises(MessageError, match=rf"labels\.{name}: must be"):
            decode(pack({**fields, "body": {**fields["body"], "labels": {**labels, name: wrong}}}), Delivery)
    without = {name: value for name, value in labels.items() if name != "truth"}
    with pytest.raises(MessageError, match=r"labels\.truth"):
        decode(pack({**fields, "body": {**fields["body"], "labels": without}}), Delivery)


def test_hints_need_a_network_that_reads_the_belief() -> None:
    with pytest.raises(ValidationError, match=r"auxiliary_weight teaches networks that read the belief"):
        RunConfig.model_validate({"cloning": {"updates": 10, "auxiliary_weight": 0.1}})
