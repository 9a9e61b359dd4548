"""A cable between two TCP endpoints that can be cut, slow, lossy, or broken off."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from queue import Queue

from common.system.closing import Closing

# What one packet of Ethernet carries of a TCP stream, and the least time after which Linux sends a lost one again.
_SEGMENT = 1448
_SENT_AGAIN_AFTER = 0.2
# Pieces that are under way in one direction; beyond that the sender waits, as it does for a full window.
_UNDER_WAY = 64


class Link(Closing):
    """Carries connections on to an endpoint; what is sent while it is cut waits, as on a lost radio link.

    Of a lossy link it shows what TCP makes of it: everything behind a lost packet waits until that is sent again, after
    0.2 s, and after twice as long each time that it is lost again.

    Attributes:
        endpoint: Zenoh endpoint to connect to, `tcp/HOST:PORT`.
        delay: seconds in each direction.
        loss: chance of each packet to be lost.
    """

    def __init__(self, target: str, address: str = "127.0.0.1") -> None:
        """Carry connections that come to an address on to a Zenoh endpoint, `tcp/HOST:PORT`."""
        host, _, port = target.removeprefix("tcp/").rpartition(":")
        self._target = host, int(port)
        self._server = socket.create_server((address, 0))
        self.endpoint = f"tcp/{address}:{self._server.getsockname()[1]}"
        self.delay = 0.0
        self.loss = 0.0
        self._chance = random.Random(0)
        self._whole = threading.Event()
        self._whole.set()
        self._sockets: list[socket.socket] = []
        self._closed = False
        threading.Thread(target=self._accept, name="link", daemon=True).start()

    def cut(self) -> None:
        """Let nothing through."""
        self._whole.clear()

    def mend(self) -> None:
        """Let everything through again."""
        self._whole.set()

    def drop(self) -> None:
        """Break all connections off, as a restarted switch or router does."""
        broken, self._sockets = self._sockets, []
        for each in broken:
            _shut(each)

    def close(self) -> None:
        """End all connections; safe to call twice."""
        self._closed = True
        self.mend()
        self._server.close()
        self.drop()

    def _accept(self) -> None:
        while not self._closed:
            with contextlib.suppress(OSError):
                near, _ = self._server.accept()
                try:
                    far = socket.create_connection(self._target)
                except OSError:
                    # Nobody is there yet: Zenoh tries again.
                    near.close()
                    continue
                self._sockets += [near, far]
                threading.Thread(target=self._connect, args=(near, far), daemon=True).start()

    def _connect(self, near: socket.socket, far: socket.socket) -> None:
        with near, far:
            for each in (near, far):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            ways = [threading.Thread(target=self._carry, args=way, daemon=True) for way in ((near, far), (far, near))]
            for way in ways:
                way.start()
            for way in ways:
                way.join()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        """Carry one direction until either side ends it."""
        under_way: Queue[tuple[float, bytes]] = Queue(_UNDER_WAY)
        sender = threading.Thread(target=self._deliver, args=(under_way, sink), daemon=True)
        sender.start()
        data = b"-"
        while data:
            try:
                data = source.recv(1 << 16)
            except OSError:
                data = b""
            under_way.put((time.monotonic() + self.delay + self._waits(len(data)), data))
        sender.join()

    def _deliver(self, under_way: Queue[tuple[float, bytes]], sink: socket.socket) -> None:
        broken = False
        while True:
            due, data = under_way.get()
            time.sleep(max(0.0, due - time.monotonic()))
            self._whole.wait()
            if not data:
                _shut(sink)
                return
            if not broken:
                try:
                    sink.sendall(data)
                except OSError:
                    # Its other direction ends too; what still comes in this one goes nowhere.
                    broken = True

    def _waits(self, size: int) -> float:
        """Seconds for which lost packets of a piece hold it up."""
        seconds = 0.0
        for _ in range(-(-size // _SEGMENT)):
            again = _SENT_AGAIN_AFTER
            while self._chance.random() < self.loss:
                seconds += again
                again *= 2.0
        return seconds


def _shut(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
