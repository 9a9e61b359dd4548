"""Commands as people write them."""

from __future__ import annotations

from typing import Any, Final

from common.errors import HDError

_LONGEST: Final = 1000


class CommandError(HDError):
    """A command cannot be carried out now."""


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Read a command as people write it: `pause`, `return-home`, `goal 3.5 -2`.

    Raises:
        CommandError: it is empty, or has words that the command does not take.
    """
    if len(text) > _LONGEST:
        raise CommandError(f"a command has at most {_LONGEST} characters, got {len(text)}")
    verb, *rest = text.replace(",", " ").split() or [""]
    verb = verb.lower().replace("-", "_")
    if verb == "goal":
        if len(rest) != 2:
            raise CommandError(f"a goal is given as `goal X Y` in metres, got {text[:80]!r}")
        return verb, {"x": rest[0], "y": rest[1]}
    if verb == "stop" and rest:
        return verb, {"reason": " ".join(rest)}
    if rest:
        raise CommandError(f"command {verb!r} takes no arguments, got {' '.join(rest)[:80]!r}")
    return verb, {}
