"""The fault table in short; `make faults` is the long form. Power and certificates have tests of their own, too."""

import random

import pytest

from benchmarks.faults.__main__ import NAMES, SHORT, faults
from benchmarks.faults.mutation import mutated
from benchmarks.faults.table import TITLES, Row, merged

# Frozen learners, full disks and damaged files have quick tests of their own, and `test_training` kills a learner.
ALWAYS = ("cut", "break", "lossy", "hostile", "deaths")


def tried(names, folder):
    rows = list(faults(names, SHORT, folder))
    untried = [row.seen for row in rows if row.wrong == "not tried"]
    wrong = [f"{row.name}: {row.wrong} ({row.seen})" for row in rows if row.wrong and row.wrong != "not tried"]
    assert wrong == []
    assert len(rows) == len(names)
    return untried


@pytest.mark.timeout(400)
def test_nothing_that_fails_loses_or_doubles_anything(tmp_path):
    tried(ALWAYS, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_lines_and_crowds_and_strangers_lose_or_double_nothing(tmp_path):
    if untried := tried([name for name in NAMES if name not in ALWAYS], tmp_path):
        pytest.skip("; ".join(untried))


def test_fresh_rows_take_the_place_of_those_of_the_same_fault():
    first = merged("", [Row("b", "x", "y", name="two"), Row("a", "x", "old", name="one")], ["one", "two"])
    again = merged(first, [Row("a", "x", "new", 1200, resumes=0.25, name="one")], ["one", "two"])
    lines = again.splitlines()
    assert lines[0].count("|") == lines[3].count("|") == len(TITLES) + 1
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["one", "two"]
    assert "new" in again and "old" not in again and "1,200" in again


def test_changes_at_random_are_changes_and_come_again():
    data = bytes(range(256)) * 4
    changed = [mutated(data, random.Random(seed)) for seed in range(200)]
    assert changed == [mutated(data, random.Random(seed)) for seed in range(200)]
    assert sum(each != data for each in changed) > 180
    assert {len(each) > len(data) for each in changed} == {len(each) < len(data) for each in changed} == {True, False}
