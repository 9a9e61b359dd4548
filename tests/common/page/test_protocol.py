import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import MessageError
from common.page.protocol import MAX_MESSAGE, Ask, Hello, Watch, read_message

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=10,
)
names = st.sampled_from(["type", "protocol", "token", "channels", "id", "target", "verb", "arguments"])
kinds = st.sampled_from(["hello", "watch", "command", "nothing"])


@settings(max_examples=40)
@given(st.one_of(st.text(), json_values.map(json.dumps)))
def test_nothing_but_an_error_comes_of_what_is_no_message(text):
    with pytest.raises(MessageError):
        read_message(text)


@settings(max_examples=60)
@given(kinds, st.dictionaries(names, json_values, max_size=6))
def test_any_object_is_a_message_within_its_bounds_or_an_error(kind, fields):
    try:
        found = read_message(json.dumps({"protocol": 1, **fields, "type": kind}))
    except MessageError as error:
        assert str(error)
        return
    assert isinstance(found, {"hello": Hello, "watch": Watch, "command": Ask}[kind])


def test_messages_are_read_as_they_are_documented():
    assert read_message('{"type":"hello","protocol":1}') == Hello("")
    assert read_message('{"type":"watch","channels":["robots","robot/a/*"]}') == Watch(("robots", "robot/a/*"))
    asked = read_message('{"type":"command","id":3,"target":"a","verb":"goal","arguments":{"x":1.5,"y":2}}')
    assert asked == Ask(3, "a", "goal", {"x": 1.5, "y": 2})


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ({"type": "hello", "protocol": 2}, "hello.protocol"),
        ({"type": "hello", "protocol": 1, "token": "x" * 1000}, "hello.token"),
        ({"type": "watch", "channels": ["x"] * 100}, "watch.channels"),
        ({"type": "watch", "channels": [""]}, "watch.channels"),
        ({"type": "command", "id": -1, "verb": "stop"}, "command.id"),
        ({"type": "command", "id": True, "verb": "stop"}, "command.id"),
        ({"type": "command", "id": 1}, "command.verb"),
        ({"type": "command", "id": 1, "verb": "stop", "arguments": []}, "command.arguments"),
        ({"type": "shout"}, "type"),
    ],
)
def test_errors_name_the_field(message, named):
    with pytest.raises(MessageError, match=named):
        read_message(json.dumps(message))


def test_a_message_has_a_longest_length():
    with pytest.raises(MessageError, match=str(MAX_MESSAGE)):
        read_message(" " * (MAX_MESSAGE + 1))
