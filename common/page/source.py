"""What a page is made of: a source of data that carries commands out, and a site of files."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from common.page.hub import Hub
from common.system.closing import Closing

if TYPE_CHECKING:
    from starlette.routing import BaseRoute


@dataclass(frozen=True, slots=True)
class Command:
    """A command from a browser whose token is right.

    Attributes:
        target: what is commanded, such as the name of a robot; empty where there is one thing only.
        verb: one of the source's `verbs`.
        arguments: a JSON object, as it came.
        client: address of the browser, for the log.
    """

    target: str
    verb: str
    arguments: Mapping[str, Any]
    client: str


class Source(Closing):
    """Fills the hub of a page, and carries commands out.

    Attributes:
        verbs: commands that it knows.
        urgent: those of them that never wait for another command.
    """

    verbs: ClassVar[Sequence[str]] = ()
    urgent: ClassVar[Sequence[str]] = ()

    @abstractmethod
    def refresh(self, hub: Hub) -> None:
        """Put what is new into the hub; called `PageSettings.rate` times a second, always in the same thread.

        What it raises is logged, and the next call comes all the same. A source may also put from threads of its own.
        """

    def carry_out(self, command: Command) -> Mapping[str, Any]:
        """Carry a command out in a thread of a pool and return the state after it, ready for JSON.

        Raises:
            HDError: it is refused; its text is the answer.
        """
        raise NotImplementedError(f"{type(self).__name__} names verbs but carries none out: {command.verb!r}")

    def close(self) -> None:
        """Let go of what the source holds; safe to call twice."""


@dataclass(frozen=True, slots=True)
class Site:
    """The files of a page.

    Attributes:
        name: of the page, for programs: ``robots`` or ``training``.
        folder: with ``index.html``; its files are served below ``/``, those of `common/page/static` below ``/core/``.
        routes: more paths, such as pictures that lie in a run's folder.
    """

    name: str
    folder: Path
    routes: Sequence[BaseRoute] = field(default=())
