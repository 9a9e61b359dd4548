"""Maps are looked at before a run begins."""

import logging

from common.config import resolve
from learner import map_check


def run_of(*train: str):
    return resolve({"maps": {"train": list(train)}, "simulator": {"name": "grid"}})


def test_a_machine_too_slow_for_the_check_starts_unchecked_and_says_so(monkeypatch, caplog):
    monkeypatch.setattr(map_check, "_SECONDS", 0.01)
    with caplog.at_level(logging.WARNING):
        map_check.check_maps(run_of("generator:rooms"))
    assert "could not be checked within 0.01 s" in caplog.text
