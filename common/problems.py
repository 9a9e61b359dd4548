"""What pydantic finds wrong with a document, in the words of this project's messages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        path: the keys that lead to it, joined by dots; empty for the whole document.
        words: what was expected, as a part of a sentence: "input should be greater than 0".
        given: what came instead.
        kind: pydantic's name for it, such as "missing".
    """

    path: str
    words: str
    given: Any
    kind: str


def problems(error: ValidationError) -> Iterator[Problem]:
    """Yield all that is wrong, in the order of the fields."""
    for each in error.errors(include_url=False):
        words = each["msg"].removeprefix("Value error, ")
        yield Problem(".".join(map(str, each["loc"])), words[:1].lower() + words[1:], each["input"], each["type"])


def first_problem(error: ValidationError) -> Problem:
    """Return the first thing that is wrong: for a message that tells one at a time."""
    return next(problems(error))
