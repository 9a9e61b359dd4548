"""Names for what can be added without editing this package: planners, simulators, tasks and generators of worlds.

A registry finds three kinds of names:

- a shipped one, such as `tour`;
- one that an installed package adds by an entry point of the registry's group::

      [project.entry-points."hdplanner.planners"]
      mine = "my_package.planner:MyPlanner"

- ``MODULE:CLASS``: a class, function or object of a module that Python finds, or that lies in the current folder.

The last one runs code of whoever wrote the name. Local command lines and local files may say it; what comes from the
bus, or in a file that others made, may not (see `refuse_modules`).
"""

from __future__ import annotations

import difflib
import logging
import os
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from common.errors import ConfigError, HDError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

log = logging.getLogger(__name__)

_MODULE_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


@dataclass(frozen=True, slots=True)
class Entry:
    """Where something that ships is defined.

    Attributes:
        path: ``MODULE:NAME``; imported only when it is asked for.
        summary: one line for listings.
    """

    path: str
    summary: str


class Registry:
    """Everything of one kind, by name.

    Usage::

        tour = Entry("common.planners.exploration.tour:Tour", "a tour")
        REGISTRY = Registry("planner", "hdplanner.planners", {"tour": tour})
        factory = REGISTRY.load("tour")

    Attributes:
        word: what one of them is called, for messages.
        group: of the entry points that installed packages add.
        shipped: those that ship, in the order of listings.
    """

    def __init__(self, word: str, group: str, shipped: Mapping[str, Entry], error: type[HDError] = ConfigError) -> None:
        """Set up; `error` is what a name that cannot be had raises."""
        self.word = word
        self.group = group
        self.shipped = dict(shipped)
        self._error = error

    def names(self) -> list[str]:
        """Return all names: shipped ones first, then those of installed packages."""
        return [*self.shipped, *sorted(self._installed())]

    def check(self, name: str) -> None:
        """Raise the registry's error for a name that is not known and no MODULE:CLASS; nothing is imported."""
        if is_module_path(name) or name in self.shipped or name in self._installed():
            return
        if ":" in name:
            raise self._error(
                f"{name!r} is not a {self.word}: expected MODULE:CLASS, such as "
                f"my_package.my_module:My{self.word.capitalize()}"
            )
        known = self.names()
        raise self._error(
            f"there is no {self.word} {name!r}{did_you_mean(name, known)}; {self.word}s are: {', '.join(known)}, or "
            "MODULE:CLASS for your own (docs/extending.md)"
        )

    def load(self, name: str) -> Any:
        """Return what a name stands for, imported now.

        Raises:
            HDError: of the registry's kind; there is no such name, or its module cannot be imported.
        """
        self.check(name)
        if name in self.shipped:
            # What it lacks, such as an extra that is not installed, it says itself.
            return _imported(self.shipped[name].path)
        path = name
        if is_module_path(name):
            _look_here()
        else:
            path = self._installed()[name].value
        try:
            return load_path(path)
        except ConfigError as error:
            raise self._error(f"cannot load {self.word} {name!r}: {error}") from error

    def summary(self, name: str) -> str:
        """Return one line about a name: of what does not ship its own `summary`, or the first line of its docstring."""
        if name in self.shipped:
            return self.shipped[name].summary
        loaded = self.load(name)
        text = getattr(loaded, "summary", None) or loaded.__doc__ or "no description"
        return str(text).strip().partition("\n")[0]

    def _installed(self) -> dict[str, EntryPoint]:
        """Return the entry points of installed packages; shipped names stay what they are."""
        from importlib.metadata import entry_points

        found: dict[str, EntryPoint] = {}
        for point in entry_points(group=self.group):
            other = found.get(point.name)
            if point.name in self.shipped:
                log.warning("package %s adds the %s %r, a shipped name: ignored", _owner(point), self.word, point.name)
            elif other is not None and other.value != point.value:
                raise self._error(
                    f"packages {_owner(other)} and {_owner(point)} both add the {self.word} {point.name!r}: "
                    "uninstall one of them"
                )
            else:
                found[point.name] = point
        return found


class NamedPart(NamedTuple):
    """A name in a configuration.

    Attributes:
        path: of the setting that holds it, dotted.
        registry: that knows it.
        name: what it says.
    """

    path: str
    registry: Registry
    name: str


def is_module_path(name: str) -> bool:
    """Whether a name has the form MODULE:CLASS, so that its use imports code."""
    return _MODULE_PATH.fullmatch(name) is not None


def load_path(path: str) -> Any:
    """Import MODULE:NAME.

    Raises:
        ConfigError: the module cannot be imported, or has no such name.
    """
    try:
        return _imported(path)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"{error} (expected MODULE:CLASS that can be imported here)") from error
    except HDError:
        raise
    except Exception as error:
        module = path.partition(":")[0]
        raise ConfigError(f"importing module {module} fails with {type(error).__name__}: {error}") from error


def refuse_modules(parts: Iterable[NamedPart], allowed: Collection[str], source: str, remedy: str) -> None:
    """Raise ConfigError where something that others wrote names a module that nobody here has named.

    Args:
        parts: the names that it holds.
        allowed: those that the local user has given.
        source: what holds them, for the message.
        remedy: what to do about it.
    """
    for part in parts:
        if ":" in part.name and part.name not in allowed:
            raise ConfigError(
                f"{source} names the {part.registry.word} {part.name!r} ({part.path}), which is code of a module, and "
                f"code is loaded only when this machine's user names it: {remedy}"
            )


def did_you_mean(word: str, known: Collection[str]) -> str:
    """Return a hint at the nearest known word, with a space before it; empty where none is near."""
    close = difflib.get_close_matches(word.lower(), known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _imported(path: str) -> Any:
    module, _, names = path.partition(":")
    found: Any = import_module(module)
    for name in names.split("."):
        found = getattr(found, name)
    return found


def _look_here() -> None:
    """Let modules of the current folder be found, as the commands of an installed package do not by themselves."""
    here = os.path.realpath(os.curdir)
    # At the end: a folder that holds a package called `common` must not come before ours.
    if here not in sys.path:
        sys.path.append(here)


def _owner(point: EntryPoint) -> str:
    return "?" if point.dist is None else point.dist.name
