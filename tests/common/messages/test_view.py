import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.messages.codec import pack, unpack
from common.messages.schema import decode, encode
from common.messages.stats import ActorStats
from common.messages.view import MAX_VIEWPOINTS, EpisodeView
from tests.common.messages import samples
from tests.common.messages.test_schema import change, equal

RNG = np.random.default_rng(4)


@settings(max_examples=20)
@given(st.integers(0, 1 << 16), st.integers(1, 70), st.integers(1, 70), st.integers(1, 30))
def test_a_view_comes_back_unchanged(seed, rows, columns, viewpoints):
    view = samples.view(np.random.default_rng(seed), (rows, columns), viewpoints)
    assert equal(decode(encode(view), EpisodeView), view)


def test_a_belief_of_a_large_world_travels_in_a_few_kilobytes():
    cells = np.full((1024, 1024), -1, np.int8)
    cells[100:900, 100:900] = 0
    cells[100:900:50, 100:900] = 100
    view = samples.view(RNG)
    assert (
        len(encode(EpisodeView(**{name: getattr(view, name) for name in view.__slots__} | {"cells": cells}))) < 30_000
    )


def packed(data):
    return np.frombuffer(data, np.uint8)


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("cells", packed(zlib.compress(bytes(1 << 24))), "30 x 40 bytes unpacked"),
        ("cells", packed(zlib.compress(bytes(1199))), "30 x 40 bytes unpacked"),
        ("cells", packed(zlib.compress(b"\x80" * 1200)), "-1 or 0 to 100"),
        ("cells", packed(b"nonsense"), "packed by zlib"),
        ("rows", 1 << 16, "cells"),
        ("kinds", np.full(12, 3, np.uint8), "kinds"),
        ("edges", np.full((1, 2), 12, np.uint16), "edges"),
        ("viewpoints", np.zeros((MAX_VIEWPOINTS + 1, 2), np.float32), "viewpoints"),
        ("way", np.full((1, 2), np.nan, np.float32), "way"),
        ("beacon", np.zeros((2, 2), np.float32), "beacon"),
        ("world", "a\nb", "world"),
        ("family", ..., "family"),
    ],
)
def test_a_view_beyond_its_bounds_is_refused_by_name(path, value, named):
    with pytest.raises(MessageError, match=named):
        decode(change(samples.view(RNG), path, value), EpisodeView)


def test_statistics_of_actors_that_do_not_tell_their_restarts_are_read():
    told = ActorStats("desk-0", "desk", 4711, 1200, 9, 64.5, 12, 3.25, 0, "acting")
    fields = unpack(encode(told))
    del fields["restarts"], fields["last_error"]
    assert decode(pack(fields), ActorStats) == told
