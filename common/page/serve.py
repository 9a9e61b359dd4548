"""Runs a page in this process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from common.errors import HDError
from common.page.hub import PageError
from common.page.options import PageSettings, is_local, url_of
from common.page.protocol import MAX_MESSAGE
from common.page.source import Site, Source
from common.system.extras import optional
from common.system.logs import setup_logging
from common.system.signals import stopping_signals

with optional("a page", "page"):
    import uvicorn

    from common.page.app import make_app

log = logging.getLogger(__name__)

_PING_SECONDS: Final = 15.0
# A connection whose other end takes nothing for so long is cut by the system, milliseconds.
_STUCK: Final = 30_000
# A page gives way to whatever drives or trains beside it.
_NICENESS: Final = 5


class _Server(uvicorn.Server):
    """A server that leaves the signals alone, and tells when it answers."""

    def __init__(self, config: uvicorn.Config, tell: Callable[[], object]) -> None:
        super().__init__(config)
        self._tell = tell

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self._tell()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


def serve(
    settings: PageSettings, site: Site, source: Source, announce: Callable[[str], object] = lambda _: None
) -> None:
    """Serve a page until SIGINT or SIGTERM.

    Args:
        settings: where, and who may command.
        site: its files.
        source: of its data; it is closed at the end.
        announce: is told the page's address as soon as it answers.

    Raises:
        PageError: the address cannot be listened at.
    """
    with source, listen(settings) as listener:
        config = uvicorn.Config(
            make_app(settings, site, source),
            http="h11",
            ws="websockets-sansio",
            log_config=None,
            access_log=False,
            log_level="warning",
            server_header=False,
            ws_max_size=MAX_MESSAGE,
            ws_ping_interval=_PING_SECONDS,
            ws_ping_timeout=_PING_SECONDS,
            # Tiles are small already, and compressing for each browser anew is what would cost.
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
        )
        address = url_of(settings.host, listener.getsockname()[1])
        server = _Server(config, lambda: announce(address))

        def stop() -> None:
            server.should_exit = True

        if not is_local(settings.host):
            log.warning(
                "the page at %s is served without TLS: everybody who reaches it can read it, and whoever listens in "
                "learns the token; use 127.0.0.1 and an SSH tunnel, or a proxy with TLS (docs/page.md)",
                settings.host,
            )
        with stopping_signals(stop, lambda: server.should_exit):
            asyncio.run(server.serve(sockets=[listener]))


def listen(settings: PageSettings) -> socket.socket:
    """Return a socket that listens where the page is to be.

    Raises:
        PageError: the address is taken, or not of this machine.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listener = socket.socket(family)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if sys.platform.startswith("linux"):
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _STUCK)
        listener.bind((settings.host, settings.port))
        listener.listen(settings.clients)
    except OSError as error:
        listener.close()
        raise PageError(
            f"the page cannot be served at {settings.host}:{settings.port}: {error.strerror or error}; give --page "
            "another port or host"
        ) from None
    return listener


def page_main(make: Callable[[Mapping[str, Any]], tuple[Site, Source]]) -> None:
    """Be the process of a page that `PageProcess` started: read the request from standard input, and serve.

    Args:
        make: builds the page's site and source of the request that `PageProcess` was given.
    """
    request = json.loads(sys.stdin.read())
    setup_logging(request["log_level"])
    os.nice(_NICENESS)

    def tell(**message: str) -> None:
        sys.stdout.write(json.dumps(message) + "\n")
        sys.stdout.flush()

    try:
        settings = PageSettings(**request["settings"])
        serve(settings, *make(request["request"]), lambda address: tell(address=address))
    except HDError as error:
        tell(failed=str(error))
        sys.exit(1)
