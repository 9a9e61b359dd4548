"""Commands as people write them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from common.errors import HDError
from common.messages.replies import ROBOT_VERBS

RELEASE: Final = "hd-deploy command release --who NAME --why REASON"
"""How the emergency stop is released."""
_LONGEST: Final = 1000
_LONGEST_REASON: Final = 200


class CommandError(HDError):
    """A command cannot be carried out now."""


def parse(text: str) -> tuple[str, dict[str, Any]]:
    """Read a command as people write it: `pause`, `return-home`, `goal 3.5 -2`.

    Raises:
        CommandError: it is no command of a robot, or has words that the command does not take.
    """
    if len(text) > _LONGEST:
        raise CommandError(f"a command has at most {_LONGEST} characters, got {len(text)}")
    verb, *rest = text.replace(",", " ").split() or [""]
    verb = verb.lower().replace("-", "_")
    if verb not in ROBOT_VERBS:
        known = ", ".join(ROBOT_VERBS).replace("_", "-")
        raise CommandError(f"a command must be one of {known}, got {text[:80]!r}")
    if verb == "goal":
        if len(rest) != 2 or not all(map(_is_number, rest)):
            raise CommandError(f"a goal is given as `goal X Y` in metres, got {text[:80]!r}")
        return verb, {"x": rest[0], "y": rest[1]}
    if verb == "stop" and rest:
        return verb, {"reason": " ".join(rest)}
    if rest:
        raise CommandError(f"command {verb!r} takes no arguments, got {' '.join(rest)[:80]!r}")
    return verb, {}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def release_of(arguments: Mapping[str, Any]) -> tuple[str, str]:
    """Return who releases the emergency stop, and why.

    Raises:
        CommandError: one of the two is missing, no text, or endless.
    """
    who, why = (arguments.get(name) for name in ("who", "why"))
    if not all(isinstance(text, str) and 0 < len(text.strip()) <= _LONGEST_REASON for text in (who, why)):
        raise CommandError(
            "releasing the emergency stop requires a name and the reason why it is safe, each at most "
            f"{_LONGEST_REASON} characters: {RELEASE}"
        )
    return str(who).strip(), str(why).strip()
