"""Several ranks that share a batch make the weights of one, whatever part of it each has."""

from __future__ import annotations

import io
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config import RunConfig
from learner.algorithm.batch import TransitionBatch
from learner.algorithm.factory import make_learner
from learner.algorithm.policy_learner import PolicyLearner
from learner.ranks.messages import batch_fields, frame, read_batch, read_frame, read_state, state_fields
from learner.ranks.shards import split
from tests.learner.runs import PPO, small_config
from tests.transitions import random_transitions

CPU = torch.device("cpu")


class ThreadRank:
    """Ranks that are threads of this process."""

    def __init__(self, rank: int, size: int, barrier: threading.Barrier, board: dict[int, torch.Tensor]) -> None:
        self.rank, self.size, self._barrier, self._board = rank, size, barrier, board

    def sum(self, values: torch.Tensor) -> torch.Tensor:
        self._board[self.rank] = values.detach().clone()
        self._barrier.wait(20.0)
        whole = torch.stack([self._board[rank] for rank in range(self.size)]).sum(0)
        self._barrier.wait(20.0)
        return whole.to(values.dtype)


def update_together(learners: list[PolicyLearner], parts: list[TransitionBatch]) -> list[dict[str, float]]:
    barrier, board = threading.Barrier(len(learners)), {}
    for rank, learner in enumerate(learners):
        learner.ranks = ThreadRank(rank, len(learners), barrier, board)
    with ThreadPoolExecutor(len(learners)) as pool:
        return list(pool.map(lambda pair: pair[0].step(pair[1]), zip(learners, parts, strict=True)))


def weights(learner: PolicyLearner) -> dict[str, torch.Tensor]:
    return {name: value for name, value in learner.state()[0].items() if not name.startswith("optimiser.")}


def config(**changes: object) -> RunConfig:
    tree: dict[str, object] = {
        "cloning": {"updates": 2, "anchor_weight": 0.1},
        "contrastive": {"beacons": True},
        "sac": {"critic_only_updates": 1, "target_interval": 2},
    }
    return small_config(**(tree | changes))


TOLD = {"sac": {"privileged_critic": True, "critic_only_updates": 1}, "reward": {"kind": "potential"}}


@pytest.mark.parametrize(
    ("changes", "labelled"),
    [({}, 0.5), (PPO | {"ppo": {"value_only_updates": 1}}, 1.0), (TOLD, 1.0)],
    ids=["sac", "ppo", "privileged"],
)
def test_three_ranks_make_the_weights_of_one_in_every_stage(changes: dict, labelled: float) -> None:
    run = config(**changes)
    rng = np.random.default_rng(3)
    alone, team = make_learner(run, CPU), [make_learner(run, CPU) for _ in range(3)]
    stages = []
    for _ in range(5):
        batch = random_transitions(rng, 9, (2, 15), labelled=labelled)
        # All start from the same weights: Adam's first steps turn rounding into whole steps where a gradient is nought.
        for learner in team:
            learner.restore(*alone.state())
        stages.append(alone.stage)
        single = alone.update(batch)
        figures = update_together(team, split(batch, 3))
        for own in figures:
            assert own == pytest.approx(single, rel=2e-4, abs=2e-5)
        assert figures[0] == figures[1] == figures[2]
        wanted, (first, *others) = weights(alone), map(weights, team)
        for name, value in first.items():
            close = torch.isclose(value, wanted[name], rtol=1e-3, atol=2e-5)
            assert close.float().mean() > 0.99, name
            assert all(torch.equal(other[name], value) for other in others)
    assert len(set(stages)) == 3


def test_ranks_whose_parts_hold_nothing_of_a_kind_do_not_wait_for_ever() -> None:
    run = config()
    rng = np.random.default_rng(4)
    told = random_transitions(rng, 3, (2, 12), labelled=1.0)
    ended = replace(told, terminal=np.ones(3, dtype=np.bool_), next_valid=np.ones(3, dtype=np.bool_))
    unknown = replace(told, next_valid=np.zeros(3, dtype=np.bool_), terminal=np.zeros(3, dtype=np.bool_))
    no_labels = replace(told, labelled=np.zeros(3, dtype=np.bool_))
    team = [make_learner(run, CPU) for _ in range(3)]
    for _ in range(4):
        figures = update_together(team, [ended, unknown, no_labels])
        assert figures[0] == figures[1] == figures[2]


def test_a_figure_that_is_not_finite_on_one_rank_changes_nothing_on_any() -> None:
    run = config(cloning={"updates": 0})
    rng = np.random.default_rng(5)
    good, bad = (random_transitions(rng, 4, (3, 12), labelled=1.0) for _ in range(2))
    bad.rewards[1] = np.nan
    bad.next_valid[1] = True
    team = [make_learner(run, CPU) for _ in range(2)]
    before = weights(team[0])
    figures = update_together(team, [good, bad])
    assert not np.isfinite(figures[0]["loss/critic"]) and not np.isfinite(figures[1]["loss/critic"])
    for learner in team:
        assert learner.updates == 0
        assert all(torch.equal(value, before[name]) for name, value in weights(learner).items())


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12), st.integers(0, 20))
def test_parts_of_a_batch_are_the_batch_and_none_is_empty(seed: int, size: int, more: int) -> None:
    rng = np.random.default_rng(seed)
    batch = random_transitions(rng, size + more, (2, 15), labelled=0.5)
    parts = split(batch, size)
    assert len(parts) == size and all(len(part) for part in parts)
    for name in ("rewards", "beacons", "families"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(batch, name))
    nodes = np.concatenate([part.observations.offsets for part in parts])
    assert np.array_equal(nodes, batch.observations.offsets)
    same = read_batch(_through_a_pipe(batch_fields(parts[0])))
    assert np.array_equal(same.observations.neighbours, parts[0].observations.neighbours)
    assert (same.labels is None) == (parts[0].labels is None)


def test_a_state_survives_the_way_to_a_helper() -> None:
    learner = make_learner(config(), CPU)
    learner.update(random_transitions(np.random.default_rng(6), 4, (2, 12), labelled=1.0))
    tensors, values = learner.state()
    moved, told = read_state(_through_a_pipe(state_fields(tensors, values)))
    assert told == values
    assert moved.keys() == tensors.keys()
    assert all(torch.equal(moved[name], value) for name, value in tensors.items())


def _through_a_pipe(fields: dict) -> dict:
    message = read_frame(io.BytesIO(frame("test", body=fields)))
    assert message is not None
    return message["body"]
