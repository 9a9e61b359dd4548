"""Somebody else's client of the page, written after docs/page.md alone: nothing of the package is imported here."""

import json
import struct
import time
from contextlib import ExitStack

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

SIDE = 64


class Grid:
    """A grid as its tiles tell it: cells as ROS has them (-1, 0, 100)."""

    VALUES = np.array([-1, 0, 100], np.int8)

    def __init__(self):
        self.tiles = {}
        self.anchor = (0.0, 0.0)
        self.resolution = 0.0
        self.frames = 0

    def take(self, body):
        whole, x, y, self.resolution, count = struct.unpack_from("<BdddH", body)
        if whole:
            self.tiles.clear()
        self.anchor = (x, y)
        at = 27
        for _ in range(count):
            row, column, size = struct.unpack_from("<hhH", body, at)
            runs = np.frombuffer(body, np.uint8, size, at + 6)
            states = np.repeat(runs >> 6, (runs & 63).astype(np.int64) + 1)
            assert states.size == SIDE * SIDE
            self.tiles[row, column] = self.VALUES[states].reshape(SIDE, SIDE)
            at += 6 + size
        assert at == len(body)
        self.frames += 1

    def cells(self, shape, origin):
        """Return the cells of a box: its shape and the lower left corner of its first cell, metres."""
        rows, columns = shape
        if not self.tiles:
            # Of a grid in which nothing is known nothing is sent.
            return np.full(shape, -1, np.int8)
        first = [round((a - b) / self.resolution) for a, b in zip(origin, self.anchor, strict=True)]
        found = np.full(shape, -1, np.int8)
        for (row, column), tile in self.tiles.items():
            below, left = row * SIDE - first[1], column * SIDE - first[0]
            low, high = max(below, 0), min(below + SIDE, rows)
            west, east = max(left, 0), min(left + SIDE, columns)
            if low < high and west < east:
                found[low:high, west:east] = tile[low - below : high - below, west - left : east - left]
        return found


class Reader:
    """Connects, watches channels and commands."""

    def __init__(self, address, token="", channels=("*",), origin=None):
        self.values, self.series, self.grids, self.gone = {}, {}, {}, []
        self.answers = {}
        self.bytes = self.frames = 0
        self.number = 0
        self.parts = ExitStack()
        url = address.replace("http", "ws") + "ws"
        self.socket = self.parts.enter_context(
            connect(url, origin=origin, max_size=1 << 24, open_timeout=60, close_timeout=0.5)
        )
        self.hello = json.loads(self.socket.recv(30))
        assert self.hello["type"] == "hello"
        assert self.hello["protocol"] == 1
        self.send(type="hello", protocol=1, token=token)
        self.welcome = json.loads(self.socket.recv(30))
        self.watch(*channels)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def close(self):
        self.parts.close()

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def watch(self, *channels):
        self.send(type="watch", channels=list(channels))

    def take(self, timeout):
        try:
            frame = self.socket.recv(timeout)
        except TimeoutError:
            return False
        self.frames += 1
        self.bytes += len(frame)
        if isinstance(frame, bytes):
            assert frame[0] == 1
            name, body = frame[2 : 2 + frame[1]].decode(), frame[2 + frame[1] :]
            self.grids.setdefault(name, Grid()).take(body)
            return True
        message = json.loads(frame)
        if message["type"] == "answer":
            self.answers[message["id"]] = message
            return True
        assert message["type"] == "update", message
        for name in message.get("gone", ()):
            self.gone.append(name)
            for known in (self.values, self.series, self.grids):
                known.pop(name, None)
        self.values.update(message.get("values", {}))
        for name, part in message.get("series", {}).items():
            items, following = self.series.get(name, ([], None))
            if part["start"] != following:
                items = []
            self.series[name] = [*items, *part["items"]], part["start"] + len(part["items"])
        return True

    def until(self, condition, seconds=20.0):
        """Take frames until a condition is true, and return its value."""
        end = time.monotonic() + seconds
        while True:
            found = condition()
            if found:
                return found
            left = end - time.monotonic()
            assert left > 0, f"not within {seconds} s; values {self.values}"
            self.take(min(left, 0.5))

    def command(self, verb, target="", **arguments):
        self.number += 1
        number = self.number
        self.send(type="command", id=number, target=target, verb=verb, arguments=arguments)
        return self.until(lambda: self.answers.pop(number, None))

    def closed(self, seconds=10.0):
        """Return the code with which the page closes the connection, and what it says before."""
        end, last = time.monotonic() + seconds, ""
        try:
            while time.monotonic() < end:
                frame = self.socket.recv(max(end - time.monotonic(), 0.01))
                last = json.loads(frame) if isinstance(frame, str) else last
        except ConnectionClosed as error:
            return error.rcvd.code if error.rcvd else 1006, last
        raise AssertionError(f"not closed within {seconds} s")
