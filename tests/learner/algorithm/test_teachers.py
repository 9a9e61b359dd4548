"""Whom each family of worlds imitates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from common.config import RunConfig
from common.config.load import resolve
from common.errors import ConfigError
from common.network.graph_arrays import GraphArrays
from common.policies.policy import Policy
from common.policies.policy_file import read_policy
from common.policies.shipped import shipped_policy
from learner.algorithm.factory import make_learner
from learner.algorithm.teachers import Teachers
from tests.transitions import random_transitions

SMALL = {"width": 16, "heads": 2, "layers": 1, "features": "guided"}


def run_of(*teachers: str, **learner: object) -> RunConfig:
    families = [{"name": f"{number}-{teacher}", "teacher": teacher} for number, teacher in enumerate(teachers)]
    return resolve({"families": families, "network": SMALL, "learner": learner, "cloning": {"updates": 10}})


def labelled(seed: int, families: list[int]):
    batch = random_transitions(np.random.default_rng(seed), len(families), (8, 20), labelled=1.0)
    return replace(batch, families=np.array(families, dtype=np.uint8))


def split(values: np.ndarray, arrays: GraphArrays) -> list[np.ndarray]:
    return np.split(values, arrays.waypoint_ptr[1:-1])


def test_the_route_is_followed_where_it_begins_at_a_waypoint() -> None:
    config = run_of("reference", "expert")
    batch = labelled(1, [0, 1] * 10)
    arrays = GraphArrays.from_observations(batch.observations, config.network)
    wanted, follows = Teachers(config).wanted(batch, arrays)
    costs = split(batch.labels.cost, arrays)
    assert follows.any()
    for k, here in enumerate(split(wanted, arrays)):
        observation = batch.observations[k]
        waypoints = observation.waypoint_nodes()
        begins = len(observation.route) and observation.route[0] in waypoints
        assert follows[k] == (k % 2 == 0 and begins)
        if not follows[k]:
            assert not here.any()
            continue
        prior = np.exp(-np.minimum(costs[k] / 4.0, 10.0))
        share = config.cloning.route_share
        expected = (1 - share) * prior / prior.sum() + share * (waypoints == observation.route[0])
        np.testing.assert_allclose(here, expected, rtol=1e-5)


def test_an_earlier_policy_is_followed_as_it_decides() -> None:
    path = shipped_policy("exploration")
    config = run_of("policy", "expert", initial_policy=str(path))
    batch = labelled(2, [0, 0, 1])
    arrays = GraphArrays.from_observations(batch.observations, config.network)
    wanted, follows = Teachers(config).wanted(batch, arrays)
    assert follows.tolist() == [True, True, False]
    policy: Policy = read_policy(path)[0]
    for k, here in enumerate(split(wanted, arrays)[:2]):
        decision = policy.decide(batch.observations[k], greedy=True, rng=np.random.default_rng(0))
        np.testing.assert_allclose(here, decision.waypoint_probabilities, atol=1e-5)


def test_a_learner_comes_to_follow_the_route() -> None:
    config = run_of("reference").model_copy(update={"seed": 3})
    learner = make_learner(config, torch.device("cpu"))
    batch = labelled(4, [0] * 16)
    losses = [learner.update(batch)["cloning/following"] for _ in range(10)]
    assert losses[-1] < losses[0]


@pytest.mark.parametrize(
    ("teacher", "network", "words"),
    [("policy", SMALL, "learner.initial_policy"), ("reference", {**SMALL, "features": "extended"}, "guided")],
)
def test_a_teacher_that_is_not_there_is_refused(teacher: str, network: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        resolve({"families": [{"name": "a", "teacher": teacher}], "network": network})


def test_a_missing_policy_is_named(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="absent"):
        Teachers(run_of("policy", initial_policy=str(tmp_path / "absent.safetensors")))
