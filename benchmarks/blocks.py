"""Generated parts of pages: what stands between a comment that says how it was made and the next `END`."""

from __future__ import annotations

from typing import Final

from common.errors import ConfigError

END: Final = "<!-- end -->"


def read_block(page: str, begin: str) -> str:
    """Return what stands between the comment `begin` and the next `END`.

    Raises:
        ConfigError: the page does not have both, the first of them once.
    """
    return _parts(page, begin)[1].strip()


def with_block(page: str, begin: str, text: str) -> str:
    """Return the page with a text between the comment `begin` and the next `END`; see `read_block`."""
    head, _, tail = _parts(page, begin)
    return f"{head}{begin}\n\n{text.strip()}\n\n{END}{tail}"


def _parts(page: str, begin: str) -> tuple[str, str, str]:
    head, _, rest = page.partition(begin)
    before, end, tail = rest.partition(END)
    if page.count(begin) != 1 or not end:
        raise ConfigError(f"expected a page with the line {begin!r} once, and {END!r} behind it: put them back")
    return head, before, tail
