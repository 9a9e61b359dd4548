"""A gate before the learner's TLS port: only what begins as TLS and stays reaches Zenoh's listeners.

Zenoh's listener rests for 100 ms after every handshake that fails, so ten connections a second that fail keep everybody
else out for as long as they come. The gate is a process of its own that holds the port. It waits for a whole first
message of TLS before it passes a connection on, drops what is something else or is gone again, and deals the rest out
to several listeners of Zenoh on loopback, past those that rest. What passes is passed on as it is: the handshake, the
certificates and the access rules are Zenoh's own.

Used as ``python -m common.bus.gate FD PORT...``: the listening socket, and the ports behind it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Final

from common.system.closing import Closing
from common.system.runtime import allow_files, python_module
from common.system.signals import ignore_signals
from common.system.threads import Ticker

log = logging.getLogger(__name__)

LISTENERS: Final = 8
"""Listeners of Zenoh behind the gate: each of them takes up with ten failing handshakes a second."""
HELLO_SECONDS: Final = 3.0
"""For the first message of TLS to arrive."""
MAX_STRANGERS: Final = 512
"""Connections whose first message is awaited; beyond that the oldest goes."""
_REST_SECONDS: Final = 0.12
_LOOK_AGAIN_SECONDS: Final = 0.01
_BRIEF_SECONDS: Final = 2.0
_CHUNK: Final = 1 << 16
_MAX_FILES: Final = 65_536
_WATCH_SECONDS: Final = 0.5
# A record of TLS: type 22 (handshake), version 3.x, length; its first byte is the message, 1 for a client's hello.
_HANDSHAKE, _HELLO, _HEADER = 0x16, 0x01, 5
_LONGEST_RECORD: Final = 1 << 14


class Gate(Closing):
    """The learner's end: holds the listening socket, and starts the gate's process again should that ever end.

    Args:
        host: to listen on, a name or an address.
        port: to listen on.
        behind: ports of Zenoh's listeners on 127.0.0.1.

    Raises:
        OSError: the address is in use, or not of this machine.
    """

    def __init__(self, host: str, port: int, behind: Sequence[int]) -> None:
        self._behind = [str(number) for number in behind]
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        both = family == socket.AF_INET6 and address[0] == "::" and socket.has_dualstack_ipv6()
        self._socket = socket.create_server(address[:2], family=family, backlog=1024, dualstack_ipv6=both)
        self._process = self._start()
        self._watch = Ticker("watching the gate", _WATCH_SECONDS, self._look)

    def close(self) -> None:
        """Give the port back, and end all connections. Safe to call twice."""
        self._watch.close()
        self._process.terminate()
        self._bury()
        self._socket.close()

    def _bury(self) -> None:
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _start(self) -> subprocess.Popen[bytes]:
        number = self._socket.fileno()
        return subprocess.Popen(
            python_module("common.bus.gate", str(number), *self._behind),
            stdin=subprocess.PIPE,  # its end tells the gate that the learner is gone
            pass_fds=[number],
            start_new_session=True,  # Ctrl-C is the learner's, which takes the gate down last
        )

    def _look(self) -> None:
        code = self._process.poll()
        if code is not None:
            log.error("the gate before the TLS port has ended with exit code %d and is started again", code)
            self._bury()
            self._process = self._start()


class _Listener:
    """One of Zenoh's listeners, and when it will have rested from the handshake that failed last."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.rested = 0.0


class _Doorman:
    """What the gate's process does.

    Args:
        ports: of Zenoh's listeners.
    """

    def __init__(self, ports: Sequence[int]) -> None:
        self._listeners = [_Listener(port) for port in ports]
        self._strangers: dict[asyncio.Task[None], None] = {}

    async def receive(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Look after one connection from its beginning to its end."""
        task = asyncio.current_task()
        assert task is not None
        self._strangers[task] = None
        if len(self._strangers) > MAX_STRANGERS:
            next(iter(self._strangers)).cancel()
        try:
            with contextlib.suppress(OSError, asyncio.IncompleteReadError, TimeoutError):
                hello = await asyncio.wait_for(_first_message(reader), HELLO_SECONDS)
                if hello and not await _gone_again(reader):
                    self._strangers.pop(task, None)
                    await self._pass_on(hello, reader, writer)
        except asyncio.CancelledError:
            # It waited longest of too many: nothing to tell anybody.
            return
        finally:
            self._strangers.pop(task, None)
            writer.close()

    async def _pass_on(self, hello: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        listener = min(self._listeners, key=lambda each: each.rested)
        began = time.monotonic()
        # Until it is known to have gone well, it counts as one that will fail.
        listener.rested = max(listener.rested, began) + _REST_SECONDS
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", listener.port)
        try:
            inner_writer.write(hello)
            await asyncio.gather(_pump(reader, inner_writer), _pump(inner_reader, writer))
        finally:
            inner_writer.close()
            if time.monotonic() - began < _BRIEF_SECONDS:
                listener.rested = max(listener.rested, time.monotonic() + _REST_SECONDS)


async def _first_message(reader: asyncio.StreamReader) -> bytes:
    """Return the first record of a connection, empty when it is no client's hello."""
    header = await reader.readexactly(_HEADER + 1)
    length = int.from_bytes(header[3:5], "big")
    if header[0] != _HANDSHAKE or header[1] != 3 or header[5] != _HELLO or not 1 <= length <= _LONGEST_RECORD:
        return b""
    return header + await reader.readexactly(length - 1)


async def _gone_again(reader: asyncio.StreamReader) -> bool:
    """Whether a client has closed its side right behind its hello, as no honest one does."""
    await asyncio.sleep(_LOOK_AGAIN_SECONDS)
    return reader.at_eof() or reader.exception() is not None


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass on what comes until it ends, then end the other side too."""
    try:
        while data := await reader.read(_CHUNK):
            writer.write(data)
            await writer.drain()
    finally:
        writer.close()


async def _serve(listening: socket.socket, ports: Sequence[int]) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    loop.add_reader(0, stop.set)  # readable at its end alone: nobody writes there
    server = await asyncio.start_server(_Doorman(ports).receive, sock=listening, limit=_CHUNK)
    async with server:
        await stop.wait()


def main(arguments: Sequence[str]) -> None:
    """Keep the gate until the learner is gone or says so."""
    ignore_signals(signal.SIGINT)
    allow_files(_MAX_FILES)
    number, *ports = (int(text) for text in arguments)
    asyncio.run(_serve(socket.socket(fileno=number), ports))


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(0)
