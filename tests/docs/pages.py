"""What the pages for people say: their blocks, their code spans, their links and headings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]

_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>[\w ]*)\n(?P<text>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL)
_NOT_RUN = re.compile(r"<!-- not run: (?P<reason>[^>]+) -->\n\s*$")
_SPAN = re.compile(r"(?<!`)`(?P<text>[^`]+?)`(?!`)")
_LINK = re.compile(r"\]\((?P<target>[^()\s]+)\)")
_HEADING = re.compile(r"^#{1,6} +(?P<text>.+?) *$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of a page.

    Attributes:
        place: page and line, as an editor opens it.
        text: what stands there.
        language: of a block; empty for a span or a link.
        reason: why a block is not run; empty where it is.
    """

    place: str
    text: str
    language: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """One Markdown page."""

    path: Path

    def __str__(self) -> str:
        return str(self.path.relative_to(ROOT))

    @property
    def text(self) -> str:
        return _text_of(self.path)

    @property
    def prose(self) -> str:
        """The page without its blocks, every line where it was."""
        return _prose_of(self.path)

    def blocks(self) -> Iterator[Piece]:
        for match in _FENCE.finditer(self.text):
            mark = _NOT_RUN.search(self.text[: match.start()])
            reason = mark["reason"].strip() if mark else ""
            yield Piece(self._place(self.text, match), match["text"], match["language"], reason)

    def spans(self) -> Iterator[Piece]:
        for match in _SPAN.finditer(self.prose):
            if "\n\n" not in match["text"]:
                yield Piece(self._place(self.prose, match), " ".join(match["text"].split()))

    def links(self) -> Iterator[Piece]:
        for match in _LINK.finditer(self.prose):
            yield Piece(self._place(self.prose, match), match["target"])

    def anchors(self) -> set[str]:
        """The anchors of the headings, as GitHub makes them."""
        anchors: set[str] = set()
        for match in _HEADING.finditer(self.prose):
            words = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", match["text"]).lower()
            name = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
            number = sum(anchor == name or anchor.startswith(f"{name}-") for anchor in anchors)
            anchors.add(f"{name}-{number}" if name in anchors else name)
        return anchors

    def _place(self, text: str, match: re.Match[str]) -> str:
        return f"{self}:{text.count(chr(10), 0, match.start()) + 1}"


@cache
def _text_of(path: Path) -> str:
    return path.read_text("utf-8")


@cache
def _prose_of(path: Path) -> str:
    return _FENCE.sub(lambda block: "\n" * block.group().count("\n"), _text_of(path))


@cache
def pages() -> tuple[Page, ...]:
    """Every page that describes how things are; the changelog describes how they were."""
    paths = [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "ros2/README.md")),
        *sorted(ROOT.glob("docs/**/*.md")),
    ]
    return tuple(Page(path) for path in paths)
