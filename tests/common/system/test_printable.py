import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.system.printable import is_printable, printable, printable_tree


@pytest.mark.parametrize(
    ("raw", "shown"),
    [
        ("desk-0", "desk-0"),
        ("Räume ✓ 地図", "Räume ✓ 地図"),
        ("\x1b[2J\x1b]0;owned\x07", r"\x1b[2J\x1b]0;owned\x07"),
        ("\x9b31m", r"\x9b31m"),
        ("a\r\nb\tc\x7f", r"a\x0d\x0ab\x09c\x7f"),
        ("abc\u202edef\u2066", r"abc\u202edef\u2066"),
        ("\ud800", r"\ud800"),
    ],
)
def test_what_a_terminal_would_obey_is_shown_instead(raw, shown):
    assert printable(raw) == shown
    assert is_printable(raw) is (raw == shown)


def test_text_of_several_lines_keeps_them():
    assert printable("one\n\ttwo\x1b[A\r", lines=True) == "one\n\ttwo\\x1b[A\\x0d"


@given(st.text())
def test_nothing_unsafe_is_left(text):
    assert is_printable(printable(text))
    assert not re.search(r"[\x00-\x1f\x7f-\x9f]", printable(text))
    assert re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", printable(text, lines=True)) is None


def test_trees_are_cleaned_through_and_through():
    tree = {"\x1b": ["\x07", {"a": "\x9b"}, 1.5, None, True]}
    assert printable_tree(tree) == {r"\x1b": [r"\x07", {"a": r"\x9b"}, 1.5, None, True]}
