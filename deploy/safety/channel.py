"""The wire between the bridge and its watchdog: one JSON object per packet, never blocking."""

from __future__ import annotations

import json
import select
import socket
from typing import Any, Final

from common.system.closing import Closing

_MAX_PACKET: Final = 1 << 17


class Channel(Closing):
    """One end of a pair of local sockets that keep packets apart and tell when the other process is gone."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end

    @classmethod
    def pair(cls) -> tuple[Channel, Channel]:
        """Return two connected ends."""
        one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(one), cls(other)

    def fileno(self) -> int:
        """Return the file descriptor, to wait for packets with `select`."""
        return self._socket.fileno()

    def wait(self, seconds: float) -> None:
        """Wait for a packet, or the other process's end, at most so many seconds.

        Raises:
            EOFError: this end is closed.
        """
        if self.fileno() < 0:
            raise EOFError("this end of the channel is closed")
        select.select([self], [], [], seconds)

    def send(self, **packet: Any) -> bool:
        """Send a packet; false when an end is closed, or the other so far behind that the packet is dropped."""
        try:
            self._socket.send(json.dumps(packet).encode())
        except OSError:
            return False
        return True

    def receive(self) -> list[dict[str, Any]]:
        """Return all packets that have arrived.

        Raises:
            EOFError: the other end is closed, because its process ended or was killed.
        """
        packets: list[dict[str, Any]] = []
        while True:
            try:
                data = self._socket.recv(_MAX_PACKET)
            except BlockingIOError:
                return packets
            except ConnectionResetError:
                # The other end was closed with packets unread; what it sent before that still follows, once.
                continue
            if not data:
                if packets:
                    return packets  # the end of the stream is still there for the next call
                raise EOFError("the other end of the channel is closed")
            packets.append(json.loads(data))

    def close(self) -> None:
        """Close this end."""
        self._socket.close()
