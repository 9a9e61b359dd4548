"""Certificates of a run across machines: an own authority, one certificate per role and host, and access rules."""

from __future__ import annotations

import datetime
import json
import logging
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import trustme

from common.errors import ConfigError
from common.ids import check_id
from common.system.documents import read_json

log = logging.getLogger(__name__)

LEARNER = "learner"
OPERATOR = "operator"
"""Certificate of people: `hd-learner status`, `pause`, `stop` from another machine."""
_LOOPBACK = ("127.0.0.1", "localhost")
_VALID_DAYS = 730
_SEEN = ("view", "outcome")
_VIEWS = [f"hd/*/{what}/**" for what in _SEEN]


def write_pki(folder: Path, hosts: Sequence[str], actors: Sequence[str], robots: Sequence[str]) -> list[Path]:
    """Make or extend the certificates of a run.

    In the folder: ``ca.pem`` (goes everywhere), ``ca.key`` (stays here), ``NAME.pem`` and ``NAME.key`` for
    ``learner``, ``operator``, each actor host and each robot, ``access.json`` (`bus.tls_access` of the learner) and
    ``names.json``. Called again with more names, it adds to what is there; certificates that exist stay valid.

    Args:
        folder: made if missing.
        hosts: names and addresses by which others reach the learner; this machine's loopback is always one.
        actors: hosts of actors; the certificate ``desk`` serves the actors ``desk`` and ``desk-...``.
        robots: names of robots.

    Returns:
        The files that were written.

    Raises:
        ConfigError: for a name that is malformed, reserved, given twice, or whose actors another one covers too.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = _read_names(folder / "names.json")
    hosts = list(dict.fromkeys([*known["hosts"], *_LOOPBACK, *hosts]))
    actors = _merge(known["actors"], actors)
    robots = _merge(known["robots"], robots)
    rules = access_rules(actors, robots)

    authority, written = _authority(folder)
    fresh = bool(written)
    for name in [LEARNER, OPERATOR, *actors, *robots]:
        certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
        outdated = name == LEARNER and hosts != known["hosts"]
        if certificate.exists() and key.exists() and not outdated and not fresh:
            continue
        identities = hosts if name == LEARNER else [name]
        expiry = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=_VALID_DAYS)
        issued = authority.issue_cert(*identities, common_name=name, not_after=expiry)
        _write(certificate, b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        _write(key, issued.private_key_pem.bytes(), secret=True)
        written += [certificate, key]
    for path, content in {
        folder / "access.json": rules,
        folder / "names.json": {"hosts": hosts, "actors": actors, "robots": robots},
    }.items():
        _write(path, json.dumps(content, indent=2).encode() + b"\n")
        written.append(path)
    log.info("certificates of the learner, %d actor hosts and %d robots are in %s", len(actors), len(robots), folder)
    return written


def access_rules(actors: Sequence[str], robots: Sequence[str]) -> dict[str, Any]:
    """Return Zenoh's access-control settings for the learner: whatever no rule allows is denied.

    Everybody reads specification, weights and presence. An actor host delivers, reports and shows presence under
    its own names alone; a robot shows presence and reports under its own. Only the operator commands. Names are
    those of the certificates, so they cannot be forged.

    Args:
        actors: hosts of actors.
        robots: names of robots.

    Raises:
        ConfigError: as `write_pki`.
    """
    _check_names(actors, robots)
    everyone = [OPERATOR, *actors, *robots]
    # A rule speaks from the learner's view: ingress is what a client sends, egress what it is sent.
    rules = [
        _rule("ask", "ingress", ["query"], ["hd/*/spec", "hd/*/weights/latest"]),
        _rule("answer", "egress", ["reply"], ["hd/*/spec", "hd/*/weights/latest"]),
        _rule("answering", "egress", ["declare_queryable"], ["hd/*/spec", "hd/*/weights/latest"]),
        _rule("notice-subscribe", "ingress", ["declare_subscriber"], ["hd/*/weights/notice"]),
        _rule("notice", "egress", ["put"], ["hd/*/weights/notice"]),
        _rule("live-watch", "ingress", ["liveliness_query", "declare_liveliness_subscriber"], ["hd/*/live/**"]),
        _rule("live-see", "egress", ["liveliness_token"], ["hd/*/live/**"]),
        _rule("deliver-answering", "egress", ["declare_queryable"], ["hd/*/experience/**"]),
        _rule("stats-wanted", "egress", ["declare_subscriber"], ["hd/*/stats/**"]),
        _rule("live-wanted", "egress", ["declare_liveliness_subscriber", "liveliness_query"], ["hd/*/live/**"]),
        _rule("command", "ingress", ["query"], ["hd/*/control/*"]),
        _rule("command-answer", "egress", ["reply"], ["hd/*/control/*"]),
        _rule("command-answering", "egress", ["declare_queryable"], ["hd/*/control/*"]),
        _rule("stats-subscribe", "ingress", ["declare_subscriber"], ["hd/*/stats/**"]),
        _rule("stats-see", "egress", ["put"], ["hd/*/stats/**"]),
        # An actor sends what it sees only where it knows of a subscriber.
        _rule("views-wanted", "egress", ["declare_subscriber"], _VIEWS),
        _rule("views-subscribe", "ingress", ["declare_subscriber"], _VIEWS),
        _rule("views-see", "egress", ["put"], _VIEWS),
        {
            "id": "everything",
            "permission": "allow",
            "flows": ["ingress", "egress"],
            "key_exprs": ["hd/**"],
            "messages": _ALL_MESSAGES,
        },
    ]
    shared = ["ask", "answer", "answering", "notice-subscribe", "notice", "live-watch", "live-see"]
    policies: list[dict[str, Any]] = [
        {"rules": shared, "subjects": everyone},
        {
            "rules": [
                *("command", "command-answer", "command-answering"),
                *("stats-subscribe", "stats-see", "views-subscribe", "views-see"),
            ],
            "subjects": [OPERATOR],
        },
        # Other routers of a mesh show the learner's certificate.
        {"rules": ["everything"], "subjects": [LEARNER]},
    ]
    for name in actors:
        mine = [name, f"{name}-$*"]
        rules += [
            _rule(f"{name}-deliver", "ingress", ["query"], [f"hd/*/experience/{own}" for own in mine]),
            _rule(f"{name}-acks", "egress", ["reply"], [f"hd/*/experience/{own}" for own in mine]),
            *_own_rules(name, mine, ("actor", "evaluator")),
            _rule(
                f"{name}-views",
                "ingress",
                ["put"],
                [f"hd/*/{what}/{role}/{own}" for what in _SEEN for role in ("actor", "evaluator") for own in mine],
            ),
        ]
        policies.append(
            {
                "rules": [
                    *(f"{name}-{what}" for what in ("deliver", "acks", "live", "stats", "views")),
                    "deliver-answering",
                    "stats-wanted",
                    "live-wanted",
                    "views-wanted",
                ],
                "subjects": [name],
            }
        )
    for name in robots:
        rules += _own_rules(name, [name], ("robot",))
        policies.append({"rules": [f"{name}-live", f"{name}-stats", "stats-wanted", "live-wanted"], "subjects": [name]})
    subjects = [{"id": name, "cert_common_names": [name]} for name in [LEARNER, *everyone]]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_ALL_MESSAGES = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]


def _own_rules(name: str, own: Iterable[str], roles: Iterable[str]) -> list[dict[str, Any]]:
    pairs = [f"{role}/{mine}" for role in roles for mine in own]
    return [
        _rule(f"{name}-live", "ingress", ["liveliness_token"], [f"hd/*/live/{pair}" for pair in pairs]),
        _rule(f"{name}-stats", "ingress", ["put"], [f"hd/*/stats/{pair}" for pair in pairs]),
    ]


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


def _check_names(actors: Sequence[str], robots: Sequence[str]) -> None:
    names = [*actors, *robots]
    for name in names:
        try:
            check_id(name, "the name in a certificate")
        except ValueError as error:
            raise ConfigError(str(error)) from None
        if name in (LEARNER, OPERATOR, "ca", "access", "names"):
            raise ConfigError(f"{name!r} is a reserved name: choose another for this actor host or robot")
        if names.count(name) > 1:
            raise ConfigError(f"{name!r} is given twice: actor hosts and robots need unique names")
    for name in actors:
        for other in actors:
            if other.startswith(f"{name}-"):
                raise ConfigError(
                    f"the certificate of {name!r} would cover the actors of {other!r} too: rename one of them"
                )


def _authority(folder: Path) -> tuple[trustme.CA, list[Path]]:
    """Return the folder's authority, and the files written when it had none."""
    certificate, key = folder / "ca.pem", folder / "ca.key"
    if certificate.exists() != key.exists():
        missing = key if certificate.exists() else certificate
        raise ConfigError(f"{missing} is missing: bring it back, or start with an empty folder")
    if certificate.exists():
        return trustme.CA.from_pem(certificate.read_bytes(), key.read_bytes()), []
    authority = trustme.CA(organization_name="hdplanner")
    _write(certificate, authority.cert_pem.bytes())
    _write(key, authority.private_key_pem.bytes(), secret=True)
    return authority, [certificate, key]


def _read_names(path: Path) -> dict[str, list[str]]:
    if not path.exists():
        return {"hosts": [], "actors": [], "robots": []}
    try:
        names = read_json(path)
        return {kind: [str(name) for name in names[kind]] for kind in ("hosts", "actors", "robots")}
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} is damaged ({error}): remove it and name all hosts again") from None


def _merge(known: Sequence[str], new: Sequence[str]) -> list[str]:
    """Return the known names, then those of the new ones that are not known; repeats among the new ones stay."""
    return [*known, *(name for name in new if name not in known)]


def _write(path: Path, content: bytes, *, secret: bool = False) -> None:
    """Write a file under a temporary name and rename it; a secret is never readable by others."""
    temporary = path.with_name(path.name + ".new")
    temporary.unlink(missing_ok=True)
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if secret else 0o644)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    temporary.replace(path)
