"""What holds for all tests."""

import gc
import logging
import os

import pytest
from hypothesis import settings

from tests.effort import THOROUGH

# Read when torch is imported, here and in every process that a test starts: networks are small and cores are shared,
# so the threads of an operation would cost more, in waiting for each other, than they bring.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Kernels compile in the first example, and machines are shared: an example's time says nothing.
for _profile in ("hdplanner", THOROUGH):
    settings.register_profile(_profile, deadline=None)
settings.load_profile("hdplanner")

# Tests in which most kernels are compiled, and files of minutes: behind the first, and not left for the end of a
# parallel run, where one process would still run them while the others have nothing to do.
_FIRST = ("tests/actors/", "tests/common/")
_LONG = ("tests/system/", "tests/examples/", "tests/test_docs.py")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: 0 if item.nodeid.startswith(_FIRST) else 1 if item.nodeid.startswith(_LONG) else 2)


def pytest_collection_finish():
    # Thousands of tests and all that they import stay to the end: the garbage collector need not look at them again,
    # and what a test makes is soon gone without it.
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call():
    """Give the root logger back as it was: a command that ran in this process leaves a handler of a closed stream."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    try:
        return (yield)
    finally:
        root.handlers[:] = handlers
        root.setLevel(level)
