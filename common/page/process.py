"""The parent's end of a page that runs as a process of its own."""

from __future__ import annotations

import json
import logging
import os
import selectors
import signal
import subprocess
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any, Final
from urllib.parse import urlsplit

from common.page.hub import PageError
from common.page.options import PageSettings
from common.system.closing import Closing
from common.system.runtime import process_environment, python_module

log = logging.getLogger(__name__)

_START_SECONDS: Final = 120.0
_CLOSE_SECONDS: Final = 3.0
_AGAIN_SECONDS: Final = 3.0


class PageProcess(Closing):
    """Starts a page, starts it again when it ends by itself, and ends it; it also ends with this process.

    Usage::

        with PageProcess("deploy.page.process", settings, {"config": config.model_dump_json()}) as page:
            print(page.address)

    Attributes:
        address: of the page, for a browser.
    """

    def __init__(self, module: str, settings: PageSettings, request: Mapping[str, Any]) -> None:
        """Start the page and wait until it can be opened.

        Args:
            module: that calls `page_main`.
            settings: of the page.
            request: ready for JSON; what the module makes the page of.

        Raises:
            PageError: it does not start; the message says why.
        """
        self._module = module
        self._request = request
        self._closed = threading.Event()
        self._settings = settings
        self._process, self.address = self._start()
        # It comes again at the same address.
        self._settings = replace(settings, port=urlsplit(self.address).port or settings.port)
        self._thread = threading.Thread(target=self._keep, name="page-process", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Process number of the page."""
        return self._process.pid

    def close(self) -> None:
        """End the page. Safe to call twice."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._end()
        self._thread.join(_CLOSE_SECONDS)

    def _keep(self) -> None:
        """Start the page again whenever it ends by itself: nothing else depends on it."""
        while True:
            code = self._process.wait()
            if self._closed.wait(_AGAIN_SECONDS):
                return
            log.error("the page ended with code %d: starting it again", code)
            _kill(self._process)
            try:
                self._process, self.address = self._start()
            except PageError as error:
                log.error("the page cannot be started again: %s", error)
            if self._closed.is_set():
                self._end()

    def _start(self) -> tuple[subprocess.Popen[bytes], str]:
        process = subprocess.Popen(
            python_module("common.system.tethered", str(os.getpid()), *python_module(self._module)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=process_environment(threads=1),
            # Ctrl-C in a terminal ends the parent, and through it this process.
            process_group=0,
        )
        assert process.stdin is not None
        level = logging.getLevelName(logging.getLogger().getEffectiveLevel()).lower()
        start = {
            "settings": asdict(self._settings),
            "request": dict(self._request),
            "log_level": level if level in {"debug", "info", "warning", "error"} else "info",
        }
        with suppress(BrokenPipeError):  # what its end means is said below
            process.stdin.write(json.dumps(start).encode())
            process.stdin.close()
        try:
            told = _first_line(process)
            if "address" not in told:
                raise PageError(told.get("failed", "the page's process said what cannot be understood"))
        except BaseException:
            _kill(process)
            raise
        return process, str(told["address"])

    def _end(self) -> None:
        process = self._process
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_CLOSE_SECONDS)
        _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _first_line(process: subprocess.Popen[bytes]) -> dict[str, Any]:
    """Return what a page's process says first, once it can be opened or has failed."""
    assert process.stdout is not None
    deadline = time.monotonic() + _START_SECONDS
    found = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while not found.endswith(b"\n"):
            if not selector.select(max(0.0, deadline - time.monotonic())):
                raise PageError(f"the page's process did not start within {_START_SECONDS:g} s: see its log lines")
            part = os.read(process.stdout.fileno(), 4096)
            if not part:
                raise PageError("the page's process ended as it started: see its log lines")
            found += part
    told = json.loads(found.splitlines()[0])
    return told if isinstance(told, dict) else {}
