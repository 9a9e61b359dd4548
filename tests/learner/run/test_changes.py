"""Which changes of its configuration a run survives, and what it is told of the others."""

import logging

import pytest

from common.errors import ConfigError
from learner.run.changes import check_change
from tests.learner.runs import PPO, small_config


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"network": {"width": 32}}, r"encoder\.embedding\.weight .* \(32, 15\) instead of \(16, 15\)"),
        # No shape shows these two.
        ({"network": {"heads": 4}}, "network.heads=2"),
        ({"network": {"features": "paper"}}, "network.features=extended"),
        ({"network": {"belief_map": True}}, "belief_map.* instead of none"),
        (PPO, "algorithm=sac and cannot change to ppo"),
        (
            {"network": {"belief_map": True}, "cloning": {"updates": 5, "auxiliary_weight": 0.1}},
            "cloning.auxiliary_weight=0.0",
        ),
    ],
)
def test_what_the_weights_do_not_survive_is_refused(changes, words):
    with pytest.raises(ConfigError, match=f"{words}.*--set learner.initial_policy=FILE"):
        check_change(small_config(), small_config(**changes))


ROOMS, HALLS = ({"name": name, "train": [f"generator:{name}"]} for name in ("rooms", "hall"))


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ({}, {"learner": {"total_updates": 5}, "network": {"variant": "hierarchical", "graph": "reduced"}}, ""),
        ({}, {"task": {"name": "navigation"}}, "the task changed"),
        ({}, {"reward": {"kind": "area"}}, "reward changed"),
        ({}, {"reward": {"kind": "area"}, "checkpoints": {"replay": False}}, ""),
        ({"families": [ROOMS]}, {"families": [ROOMS, HALLS]}, ""),
        ({"families": [ROOMS, HALLS]}, {"families": [HALLS]}, "families changed"),
    ],
)
def test_steps_that_no_longer_fit_are_named(before, after, said, caplog):
    with caplog.at_level(logging.WARNING):
        check_change(small_config(**before), small_config(**after))
    assert said in caplog.text and bool(said) == bool(caplog.records)
