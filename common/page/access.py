"""Who may see a page, and who may command on it."""

from __future__ import annotations

import hmac
import logging
import socket
from ipaddress import ip_address
from urllib.parse import urlsplit

from common.page.options import PageSettings
from common.system.printable import printable

log = logging.getLogger(__name__)


class Access:
    """Decides by host, origin and token.

    - The request's host must be an address, this machine's name, or the name that the page listens at. A web site whose
      name is made to point here after it was loaded (DNS rebinding) has another one.
    - A browser's origin must be the page itself, so that no other web site opens the WebSocket; programs send none.
    - Commands need the token.
    """

    def __init__(self, settings: PageSettings) -> None:
        """Guard a page with these settings."""
        self._token = settings.token.encode()
        own = socket.gethostname().lower()
        self._names = {"localhost", own, own.partition(".")[0], f"{own.partition('.')[0]}.local", settings.host.lower()}

    def knows_host(self, host: str) -> bool:
        """Whether a request's Host header names this page."""
        name = _name_of(f"//{host}")
        if name is None:
            return False
        try:
            ip_address(name)
        except ValueError:
            return name in self._names
        return True

    def knows_origin(self, origin: str | None, host: str) -> bool:
        """Whether an Origin header, None without one, is that of the page at this host."""
        if origin is None:
            return True
        parts = urlsplit(origin)
        return parts.scheme in {"http", "https"} and parts.netloc.lower() == host.lower()

    def may_command(self, token: str, client: str) -> bool:
        """Whether a browser's token is the page's; a wrong one is logged.

        Args:
            token: as it came.
            client: address of the browser.
        """
        if not self._token:
            return False
        if hmac.compare_digest(token.encode(), self._token):
            log.info("%s may command: its token is right", client)
            return True
        log.warning("%s sent a wrong token and may not command", client)
        return False


def refused(what: str, value: str | None, client: str) -> None:
    """Log a request that is refused for its host or origin."""
    log.warning("a request of %s is refused: its %s is %s", client, what, printable(repr(value)[:100]))


def _name_of(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None
