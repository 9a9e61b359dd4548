"""Every decoder with its corpus, and with some changed bytes; `make fuzz` is the long form."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.seeds import seeds
from tests.fuzz.targets import CORPUS, TARGETS
from tests.fuzz.trying import attempt, changed

NAMES = sorted(TARGETS)


def test_every_target_has_what_the_software_itself_writes_and_takes_it(tmp_path):
    made = seeds()
    assert made.keys() == TARGETS.keys() == {folder.name for folder in CORPUS.iterdir()}
    for name, files in made.items():
        for file, data in files.items():
            assert (CORPUS / name / file).is_file(), "make it with `python -m tests.fuzz.seeds`"
            folder = tmp_path / name / file
            folder.mkdir(parents=True)
            TARGETS[name].read(data, folder)


@pytest.mark.parametrize("name", NAMES)
def test_the_corpus_is_read_or_refused(name):
    for file in TARGETS[name].corpus():
        assert attempt(TARGETS[name], file.read_bytes()) == "", file


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_changed_bytes_are_read_or_refused(name, seed):
    assert attempt(TARGETS[name], changed(TARGETS[name], random.Random(seed))) == ""


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(data=st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(name, data):
    assert attempt(TARGETS[name], data) == ""
