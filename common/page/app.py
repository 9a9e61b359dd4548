"""The ASGI application of a page: its files, its WebSocket, and the rules for both."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import mimetypes
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from common.page.access import Access, refused
from common.page.client import Beat, Client
from common.page.hub import Hub
from common.page.options import PageSettings
from common.page.source import Site, Source
from common.palette import style_sheet
from common.system.threads import Complaints

log = logging.getLogger(__name__)

CORE: Final = Path(__file__).parent / "static"
"""The files that all pages share, served below ``/core/``."""
_HEADERS: Final = {
    # Nothing comes from elsewhere, nothing is written into the page's text, and nobody frames it.
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_TYPES: Final = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".html": "text/html"}
_TURNED_AWAY: Final = 1013


def make_app(settings: PageSettings, site: Site, source: Source, hub: Hub | None = None) -> Starlette:
    """Return the application; while it runs, the source is refreshed and browsers are sent what is new.

    Args:
        settings: of the page.
        site: its files.
        source: of its data.
        hub: between the two; one of its own when not given.
    """
    hub = hub or Hub()
    access = Access(settings)
    beat = Beat()
    plain, urgent = (ThreadPoolExecutor(8, f"page-{name}") for name in ("command", "urgent"))

    async def keep_fresh() -> None:
        """Refresh the source and ring the beat at the page's rate; a slow source only slows itself down."""
        loop = asyncio.get_running_loop()
        complaints = Complaints(f"the page {site.name!r}")
        with ThreadPoolExecutor(1, "page-source") as thread:
            due = loop.time()
            while True:
                with complaints:
                    await loop.run_in_executor(thread, source.refresh, hub)
                # A page that is frozen says nothing; one that has nothing new says this.
                hub.put("page/time", int(time.time()))
                beat.ring()
                due = max(due + 1.0 / settings.rate, loop.time())
                await asyncio.sleep(due - loop.time())

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        del app
        refreshing = asyncio.create_task(keep_fresh())
        try:
            yield
        finally:
            refreshing.cancel()
            for pool in (plain, urgent):
                pool.shutdown(wait=False, cancel_futures=True)

    async def talk(socket: WebSocket) -> None:
        client = Client(socket, hub, source, site, access, beat, settings.rate, (plain, urgent))
        if hub.views >= settings.clients:
            log.warning("a browser is turned away: %d are here already", settings.clients)
            await socket.accept()
            await socket.close(_TURNED_AWAY, f"{settings.clients} browsers are here already")
            return
        await client.run()

    routes = [
        WebSocketRoute("/ws", talk),
        Route("/core/palette.css", _Asset(style_sheet().encode(), "text/css")),
        *_assets(CORE, "/core"),
        *site.routes,
        *_assets(site.folder, ""),
    ]
    app = Starlette(routes=routes, lifespan=lifespan)
    app.add_middleware(_Guard, access=access)
    return app


class _Guard:
    """Refuses requests of strangers, and adds the headers to every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        client = (scope.get("client") or ("somebody",))[0]
        refusal = 0
        if not self._access.knows_host(host):
            refused("host", host, client)
            refusal = 421
        elif scope["type"] == "websocket" and not self._access.knows_origin(origin, host):
            refused("origin", origin, client)
            refusal = 403

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        if not refusal:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            # Before it is accepted, closing it is HTTP's 403.
            await send({"type": "websocket.close"})
        else:
            answer = PlainTextResponse("this page is not served under that name\n", refusal)
            await answer(scope, receive, send_with_headers)


class _Asset:
    """A file that is kept in memory; browsers ask whether it changed."""

    def __init__(self, data: bytes, kind: str) -> None:
        self._data = data
        self._kind = kind
        self._tag = f'"{hashlib.sha256(data).hexdigest()[:24]}"'

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        headers = {"ETag": self._tag, "Cache-Control": "no-cache"}
        unchanged = request.headers.get("if-none-match") == self._tag
        response = Response(status_code=304, headers=headers) if unchanged else Response(self._data, 200, headers)
        if not unchanged:
            response.headers["Content-Type"] = self._kind
        await response(scope, receive, send)


def _assets(folder: Path, below: str) -> list[Route]:
    """Return a route for each file of a folder; ``index.html`` is also the folder itself."""
    routes = []
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        asset = _Asset(path.read_bytes(), f"{kind}; charset=utf-8" if kind.startswith("text/") else kind)
        name = path.relative_to(folder).as_posix()
        routes.append(Route(f"{below}/{name}", asset, methods=["GET"]))
        if name == "index.html":
            routes.append(Route(f"{below}/", asset, methods=["GET"]))
    return routes
