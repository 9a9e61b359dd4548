"""Mutual TLS and access rules as Zenoh's settings, for the learner's bus and for the robot's network."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from common.bus.certificates import check_certificate
from common.errors import BusError
from common.system.documents import DocumentError, read_json


class HasTls(Protocol):
    """Settings with the files of a network's TLS, as `BusConfig` has them."""

    @property
    def tls_ca(self) -> str | None:
        """Certificate of the authority."""
        ...

    @property
    def tls_certificate(self) -> str | None:
        """This process's certificate."""
        ...

    @property
    def tls_key(self) -> str | None:
        """Its private key."""
        ...

    @property
    def tls_access(self) -> str | None:
        """JSON file of access rules."""
        ...


def tls_settings(config: HasTls) -> dict[str, Any]:
    """Return Zenoh's settings of mutual TLS with the files of a configuration.

    Raises:
        BusError: a file is not named, not there, or not what it should be; see `check_certificate`.
    """
    files = {"tls_ca": config.tls_ca, "tls_certificate": config.tls_certificate, "tls_key": config.tls_key}
    for name, path in files.items():
        if path is None or not Path(path).is_file():
            raise BusError(f"{name}: no file {path!r}; make it with 'hd-learner certificates' or correct the path")
    check_certificate(str(config.tls_ca), str(config.tls_certificate), str(config.tls_key))
    # A router both listens and connects; a peer's listening half is never used.
    return {
        "root_ca_certificate": config.tls_ca,
        "enable_mtls": True,
        "close_link_on_expiration": True,
        "listen_certificate": config.tls_certificate,
        "listen_private_key": config.tls_key,
        "connect_certificate": config.tls_certificate,
        "connect_private_key": config.tls_key,
    }


def access_settings(config: HasTls) -> dict[str, Any]:
    """Return Zenoh's settings of access control from the file of a configuration.

    Raises:
        BusError: there is no TLS, or the file cannot be read.
    """
    if config.tls_ca is None:
        raise BusError("tls_access needs tls_ca, tls_certificate and tls_key: without TLS there are no names to check")
    try:
        rules = read_json(Path(str(config.tls_access)))
    except (OSError, DocumentError) as error:
        raise BusError(f"tls_access: cannot read {config.tls_access!r} as JSON: {error}") from None
    if not isinstance(rules, dict):
        raise BusError(f"tls_access: {config.tls_access!r} must hold a JSON object of access rules")
    return rules


def certified_hosts(config: HasTls) -> tuple[str, ...]:
    """Return the names of the certificates that the access rules speak of; none without access rules.

    Raises:
        BusError: the file of access rules cannot be read.
    """
    if config.tls_access is None:
        return ()
    subjects = access_settings(config).get("subjects")
    if not isinstance(subjects, list):
        return ()
    return tuple(
        str(name)
        for subject in subjects
        if isinstance(subject, dict)
        for name in subject.get("cert_common_names") or ()
    )
