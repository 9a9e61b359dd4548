"""One browser at a page: what it may do, what it is sent, and its commands."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from concurrent.futures import Executor
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from common.errors import HDError, MessageError
from common.page.access import Access
from common.page.hub import Frame, Hub, View
from common.page.protocol import VERSION, Ask, Hello, Watch, read_message, to_text
from common.page.source import Command, Site, Source

log = logging.getLogger(__name__)

MAX_PENDING: Final = 8
"""Commands of one browser that may wait for their answer; urgent ones are taken all the same, as many again."""
SEND_SECONDS: Final = 20.0
"""A browser that takes nothing for so long has gone."""
WRONG_TOKEN_SECONDS: Final = 1.0
"""A browser with a wrong token is answered so much later, so that tokens cannot be tried in numbers."""
_PROTOCOL_ERROR: Final = 1002
# What sending to a browser that is no longer there raises; RuntimeError is Starlette's, after a close.
_GONE: Final = (WebSocketDisconnect, TimeoutError, OSError, RuntimeError)


class Beat:
    """A bell that all browsers wait for; after it rang they look for news."""

    def __init__(self) -> None:
        self._event = asyncio.Event()

    async def wait(self) -> None:
        """Wait until it rings next."""
        await self._event.wait()

    def ring(self) -> None:
        """Wake everybody who waits."""
        before, self._event = self._event, asyncio.Event()
        before.set()


class Client:
    """Serves one WebSocket until its browser goes."""

    def __init__(
        self,
        socket: WebSocket,
        hub: Hub,
        source: Source,
        site: Site,
        access: Access,
        beat: Beat,
        rate: float,
        threads: tuple[Executor, Executor],
    ) -> None:
        """Prepare to serve.

        Args:
            socket: not accepted yet.
            hub: whose channels it may watch.
            source: that carries commands out.
            site: of the page.
            access: decides who may command.
            beat: rings when there may be news.
            rate: of the beat, Hz; told to the browser.
            threads: that carry out commands, and urgent ones.
        """
        self._socket = socket
        self._hub = hub
        self._source = source
        self._site = site
        self._access = access
        self._beat = beat
        self._rate = rate
        self._threads = threads
        self._may_command = False
        self._pending: dict[bool, set[asyncio.Task[None]]] = {False: set(), True: set()}
        self._address = f"{socket.client.host}:{socket.client.port}" if socket.client else "a browser"

    async def run(self) -> None:
        """Serve until the browser goes, or takes nothing any more."""
        await self._socket.accept()
        view = self._hub.join()
        try:
            await self._say(
                type="hello", protocol=VERSION, page=self._site.name, rate=self._rate, verbs=list(self._source.verbs)
            )
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._send_news(view))
                await self._listen(view)
        except* (WebSocketDisconnect, TimeoutError, OSError) as gone:
            log.debug("%s has gone: %s", self._address, gone.exceptions[0])
        except* MessageError as wrong:
            problem = str(wrong.exceptions[0])
            log.warning("%s is turned away: %s", self._address, problem)
            await self._turn_away(problem)
        finally:
            self._hub.leave(view)
            # Its commands are finished: what was asked of a robot is done whether or not somebody waits for the answer.

    async def _send_news(self, view: View) -> None:
        while True:
            for frame in self._hub.collect(view):
                await self._send(frame)
            await self._beat.wait()

    async def _listen(self, view: View) -> None:
        while True:
            message = read_message(await self._receive())
            if isinstance(message, Watch):
                view.watch(message.patterns)
            elif isinstance(message, Hello):
                await self._welcome(message)
            else:
                await self._take(message)

    async def _receive(self) -> str:
        event = await self._socket.receive()
        if event["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(event.get("code", 1005))
        text = event.get("text")
        if text is None:
            raise MessageError("message", "must be a text frame")
        return str(text)

    async def _welcome(self, hello: Hello) -> None:
        self._may_command = False
        why = "" if hello.token else "without a token a browser only reads"
        if hello.token:
            self._may_command = self._access.may_command(hello.token, self._address)
            if not self._may_command:
                await asyncio.sleep(WRONG_TOKEN_SECONDS)
                why = "this token is wrong"
        await self._say(type="welcome", may_command=self._may_command, why=why)

    async def _take(self, ask: Ask) -> None:
        if not self._may_command:
            log.warning("%s asked for %r without the token", self._address, ask.verb)
            await self._answer(ask, "commands need the token")
            return
        if ask.verb not in self._source.verbs:
            known = ", ".join(self._source.verbs)
            await self._answer(ask, f"a command must be one of {known}, got {ask.verb[:40]!r}")
            return
        urgent = ask.verb in self._source.urgent
        pending = self._pending[urgent]
        if len(pending) >= MAX_PENDING:
            await self._answer(ask, f"{MAX_PENDING} commands wait for their answers: wait for one of them")
            return
        task = asyncio.create_task(self._carry_out(ask, urgent))
        pending.add(task)
        task.add_done_callback(pending.discard)

    async def _carry_out(self, ask: Ask, urgent: bool) -> None:
        log.info("%s commands %r of %r", self._address, ask.verb, ask.target)
        command = Command(ask.target, ask.verb, ask.arguments, self._address)
        loop = asyncio.get_running_loop()
        state, problem = None, ""
        try:
            state = await loop.run_in_executor(self._threads[urgent], self._source.carry_out, command)
        except HDError as error:
            problem = str(error)
        except Exception as error:
            # Whoever commands must hear that it failed, and not wait for an answer that never comes.
            log.exception("command %r failed", ask.verb)
            problem = f"it failed, see the page's log: {type(error).__name__}: {error}"
        try:
            await self._answer(ask, problem, state)
        except _GONE:
            log.debug("%s has gone before the answer to %r", self._address, ask.verb)

    async def _answer(self, ask: Ask, error: str, state: Mapping[str, Any] | None = None) -> None:
        await self._say(type="answer", id=ask.number, ok=not error, error=error[:1000], state=state)

    async def _say(self, **message: Any) -> None:
        await self._send(to_text(message))

    async def _send(self, frame: Frame) -> None:
        async with asyncio.timeout(SEND_SECONDS):
            if isinstance(frame, str):
                await self._socket.send_text(frame)
            else:
                await self._socket.send_bytes(frame)

    async def _turn_away(self, problem: str) -> None:
        try:
            await self._say(type="error", error=problem[:1000])
            await self._socket.close(_PROTOCOL_ERROR)
        except _GONE:
            log.debug("%s has gone before it could be told", self._address)
