"""Where a page is served and who may command there, from the command line and the environment."""

from __future__ import annotations

import os
import secrets
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Final

import typer

from common.errors import ConfigError
from common.system.addresses import LOOPBACK, listening_address
from common.system.extras import optional
from common.system.paths import expanded

TOKEN_VARIABLE: Final = "HD_PAGE_TOKEN"
"""Environment variable with the token."""
_SHORTEST_TOKEN: Final = 8
_LONGEST_TOKEN: Final = 200

PageOption = Annotated[
    str | None,
    typer.Option("--page", help="Serve the page there; the host is 127.0.0.1 when not given.", metavar="[HOST:]PORT"),
]
TokenOption = Annotated[
    Path | None,
    typer.Option(
        "--page-token",
        help=f"File with the token for the page's commands. [default: ${TOKEN_VARIABLE}, else a new one is printed]",
        metavar="FILE",
    ),
]


@dataclass(frozen=True, slots=True)
class PageSettings:
    """How a page is served.

    Attributes:
        port: 0 for any free one.
        host: address or name to listen at.
        token: that commands need; empty for a page without commands.
        rate: updates per second and browser, Hz.
        clients: browsers at a time; more are turned away.
        made_token: the token was made for this process, so that it has to be told.
    """

    port: int
    host: str = LOOPBACK
    token: str = field(default="", repr=False)
    rate: float = 5.0
    clients: int = 64
    made_token: bool = False


def page_settings(address: str, token_file: Path | None = None) -> PageSettings:
    """Return the settings that a command line and the environment give.

    Args:
        address: ``PORT``, ``HOST:PORT`` or ``[IPV6]:PORT``.
        token_file: file whose text is the token; the environment's variable, or a new one, when not given.

    Raises:
        ConfigError: the address is none, or the file cannot be read or holds no token.
    """
    host, port = listening_address(address, "--page")
    given = _given_token(token_file)
    token = given or secrets.token_urlsafe(12)
    return PageSettings(port, host, token, made_token=given is None)


def require_packages() -> None:
    """Ask for the packages of a page where the answer still reaches whoever wants one.

    Raises:
        ConfigError: the extra `page` is not installed.
    """
    with optional("--page", "page"):
        import starlette  # noqa: F401 - only asked for
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401


def url_of(host: str, port: int) -> str:
    """Return the page's address for a browser on this machine."""
    if host in {"0.0.0.0", "::"}:
        host = LOOPBACK
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def announcement(address: str, settings: PageSettings) -> str:
    """Return the line that tells where a page is and, when the token was made for it, how to command there."""
    if settings.made_token:
        return f"page: {address}#token={settings.token} (with the token that commands need; without it: reading)"
    return f"page: {address} (commands need the token)"


def is_local(host: str) -> bool:
    """Whether only this machine reaches a host."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _given_token(file: Path | None) -> str | None:
    if file is not None:
        where = str(file)
        try:
            token = expanded(file).read_text("utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"--page-token: cannot read {file}: {error}") from None
    elif TOKEN_VARIABLE in os.environ:
        where, token = f"${TOKEN_VARIABLE}", os.environ[TOKEN_VARIABLE].strip()
    else:
        return None
    if not (_SHORTEST_TOKEN <= len(token) <= _LONGEST_TOKEN and token.isprintable() and token.isascii()):
        raise ConfigError(
            f"{where} must hold {_SHORTEST_TOKEN} to {_LONGEST_TOKEN} printable ASCII characters in one line, got "
            f"{len(token)}"
        )
    return token
