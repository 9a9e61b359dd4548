"""Maps are looked at before a run begins."""

import logging

import pytest

from common.config import resolve
from common.errors import ConfigError
from learner import map_check


def run_of(*train: str):
    return resolve({"maps": {"train": list(train)}, "simulator": {"name": "grid"}})


def test_a_run_without_worlds_to_train_in_does_not_start():
    with pytest.raises(ConfigError, match=r"maps\.train=generator:rooms"):
        map_check.check_maps(run_of())
    config = resolve({"families": [{"name": "halls", "train": ["generator:hall"]}]})
    assert not map_check.has_validation(config)
    assert map_check.has_validation(run_of("generator:rooms"))


def test_a_machine_too_slow_for_the_check_starts_unchecked_and_says_so(monkeypatch, caplog):
    monkeypatch.setattr(map_check, "_SECONDS", 0.01)
    with caplog.at_level(logging.WARNING):
        map_check.check_maps(run_of("generator:rooms"))
    assert "could not be checked within 0.01 s" in caplog.text


@pytest.mark.parametrize(
    ("maps", "said"),
    [
        ({"train": ["generator:office?width=192&height=192"]}, "generator:office?seed=1000000"),
        ({"train": ["generator:office"], "validation": ["generator:office?seed=1000000"]}, ""),
        ({"train": ["generator:office", "generator:rooms"]}, ""),
        ({}, ""),
    ],
)
def test_a_best_policy_that_is_chosen_in_other_worlds_than_it_trains_in_is_warned_of(maps, said, caplog):
    map_check.check_maps(resolve({"maps": maps, "simulator": {"name": "grid"}}))
    assert ("set maps.validation" in caplog.text) == bool(said)
    assert said in caplog.text
