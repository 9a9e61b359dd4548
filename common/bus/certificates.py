"""What is wrong with the files of mutual TLS, found before others refuse them in silence."""

from __future__ import annotations

import contextlib
import logging
import ssl
from typing import Final

from common.errors import BusError

logger = logging.getLogger(__name__)

# OpenSSL's numbers of what it finds wrong with a certificate, X509_V_ERR_...
_NOT_YET_VALID: Final = 9
_EXPIRED: Final = 10
_OF_ANOTHER_AUTHORITY: Final = (7, 18, 19, 20, 21)


def check_certificate(authority: str, certificate: str, key: str) -> None:
    """Let a certificate prove itself before its own authority, as it will have to before every other process.

    Neither side of a refused link says why: the other end only never answers.

    Args:
        authority: file of the authority's certificate, PEM.
        certificate: file of this process's certificate, PEM.
        key: file of its private key, PEM.

    Raises:
        BusError: a file cannot be read, the key is that of another certificate, the certificate is that of another
            authority, or it has expired. One that is not valid yet is a warning: the clock may be set later.
    """
    server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    try:
        client.load_verify_locations(authority)
    except (OSError, ssl.SSLError) as error:
        raise BusError(f"tls_ca: {authority!r} holds no certificate that can be read: {_reason(error)}") from None
    try:
        server.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ssl.SSLError, ValueError) as error:
        raise BusError(
            f"tls_certificate {certificate!r} and tls_key {key!r} are no certificate and its private key: "
            f"{_reason(error)}; 'hd-learner certificates' makes both"
        ) from None
    try:
        _shake_hands(server, client)
    except ssl.SSLCertVerificationError as error:
        _tell(error.verify_code, authority, certificate)
    except ssl.SSLError as error:
        # Zenoh has a TLS of its own, which may take what this one does not.
        logger.debug("%s could not be tried: %s", certificate, error)


def _tell(code: int, authority: str, certificate: str) -> None:
    again = "remove it and call 'hd-learner certificates' again, or set this machine's clock"
    if code == _EXPIRED:
        raise BusError(f"tls_certificate: {certificate!r}, or the authority {authority!r}, has expired: {again}")
    if code == _NOT_YET_VALID:
        logger.warning("%s is not valid yet, so nobody can join: set this machine's clock", certificate)
    if code in _OF_ANOTHER_AUTHORITY:
        raise BusError(
            f"tls_certificate: {certificate!r} was not issued by the authority in tls_ca, {authority!r}: take both "
            "from one folder of 'hd-learner certificates'"
        )


def _shake_hands(server: ssl.SSLContext, client: ssl.SSLContext) -> None:
    """Open a link in memory; raise SSLError when the client does not accept the server's certificate."""
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = client.wrap_bio(down, up), server.wrap_bio(up, down, server_side=True)
    for _ in range(4):
        for end in ends:
            with contextlib.suppress(ssl.SSLWantReadError):
                end.do_handshake()


def _no_password() -> str:
    raise ValueError("the key has a password, which nobody could enter: store it without")


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLError) and error.reason:
        return error.reason.replace("_", " ").lower()
    return (error.strerror if isinstance(error, OSError) and error.strerror else str(error)) or type(error).__name__
