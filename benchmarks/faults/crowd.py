"""Many and hostile actors, and strangers before a TLS port."""

from __future__ import annotations

import datetime
import tempfile
import time
from pathlib import Path
from unittest.mock import patch

import trustme

from benchmarks.faults.actors import RUN, Orders
from benchmarks.faults.processes import judged
from benchmarks.faults.rig import RIG_SETTINGS, START_SECONDS, Actors, FaultError, Rig
from benchmarks.faults.table import Row
from common.bus.query import ask
from common.bus.session import open_client_session
from common.bus.spec import fetch_spec
from common.config import BusConfig
from common.errors import BusError
from common.messages.experience import Delivery
from common.messages.schema import encode
from learner.certificates import write_pki
from tests.learner.experience import episode_report
from tests.rigs.learner import Learner

_IN_FLIGHT = 256
# More than a learner lets wait, with what honest actors have in flight.
_FLOOD = 3000
# Of a process that sends hostile messages, when it is alone; a shared machine may take ten times as long.
_HOSTILE_RATE = 200.0
_CROWD_SECONDS = 300.0


def hostile(rig: Rig, messages: int) -> Row:
    """Send deliveries that were changed at random."""
    with rig.said() as said:
        orders = rig.orders("evil", endpoint=rig.learner.endpoint, number=messages, together=_IN_FLIGHT, seed=messages)
        began = time.monotonic()
        sent = rig.start("hostile", orders).finish(60.0 + messages / _HOSTILE_RATE)
        took = time.monotonic() - began
        resumes = rig.resumed(time.monotonic())
    errors = said[0].count("failed and continues") + said[0].count("could not be stored")
    seen = (
        f"{sent['refused']:,.0f} refused, {sent['taken']:,.0f} still valid, {sent['unanswered']:,.0f} unanswered; "
        f"{messages / took:,.0f}/s, {len(said[0]) / 1000:,.0f} kB of log"
    )
    fault = f"{messages:,} hostile messages"
    problem = f"{errors} exceptions" if errors else ""
    return judged(rig, fault, "refused by name, 0 exceptions", seen, said[0], resumes, problem)


def deaths(rig: Rig, number: int) -> Row:
    """Let actors die in the middle of their deliveries."""
    with rig.said() as said:
        orders = rig.orders("dying", number=number, together=8, seed=number)
        died = rig.start("dying", orders).finish(60.0 + 3.0 * number)["died"]
        since = time.monotonic()
        resumes = rig.resumed(since)
        gone = _until_gone(rig, "dying")
    fault = f"{number:,} actors die (SIGKILL) while they deliver"
    seen = f"{died:,.0f} died, the last left presence after {gone:.1f} s" if gone is not None else "some seem to live"
    problem = "" if gone is not None else "dead actors are shown as present"
    return judged(rig, fault, "gone from the status, others continue", seen, said[0], resumes, problem)


def _until_gone(rig: Rig, name: str, seconds: float = 10.0) -> float | None:
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        there = [actor for actor in rig.status()["actors"] if actor["alive"] and actor["name"].startswith(name)]
        if not there:
            return time.monotonic() - began
        time.sleep(0.2)
    return None


def crowded(rig: Rig, actors: int, messages: int) -> Row:
    """Let many honest actors deliver as fast as they can to a learner that strangers have filled up."""
    processes = max(1, actors // 50)
    with rig.said() as said:
        flood = rig.orders("flood", endpoint=rig.learner.endpoint, number=10**9, together=_FLOOD, seed=1)
        stranger = rig.start("hostile", flood)
        honest = [
            rig.start(
                "honest",
                rig.orders(f"crowd{n}", number=actors // processes, rate=50.0, messages=messages, seed=n),
            )
            for n in range(processes)
        ]
        began = time.monotonic()
        waits, problems = [], []
        for each in honest:
            try:
                waits.append(each.finish(_CROWD_SECONDS)["longest_wait"])
            except FaultError as error:
                problems.append(str(error))
        took = time.monotonic() - began
        answers = rig.answers()
        stranger.end()
        resumes = rig.resumed(time.monotonic())
    fault = f"{actors} honest actors on a learner that is full: {_FLOOD:,} hostile messages wait all the time"
    if problems:
        seen = f"not all {actors * messages:,} messages in {took:.0f} s"
    else:
        first = f"first acknowledgement after {max(waits):.1f} s at most"
        seen = f"all {actors * messages:,} messages in {took:.0f} s; {first}"
    unanswered = "" if answers else "the learner answered no command"
    return judged(rig, fault, "all are heard", seen, said[0], resumes, *problems, unanswered)


def certificates(knocks: int) -> Row:
    """Let strangers try a TLS port: without a certificate, with wrong ones, with a right one under a wrong name."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pki, other, late = folder / "pki", folder / "other", folder / "late"
        for place in (pki, other, late):
            place.mkdir()
        write_pki(pki, [], ["desk", "lab"], [])
        write_pki(other, [], ["desk"], [])
        _expired(pki, late)
        settings = [*RIG_SETTINGS, f"bus.tls_access={pki / 'access.json'}"]
        settings += [f"bus.{key}={value}" for key, value in _files(pki, "learner").items()]
        learner = Learner(folder, settings, scheme="tls")
        learner.launch("start")
        try:
            return _strangers(learner, pki, other, late, knocks)
        finally:
            learner.end()


def _strangers(learner: Learner, pki: Path, other: Path, late: Path, knocks: int) -> Row:
    honest = BusConfig(listen=learner.endpoint, **_files(pki, "lab"))
    with open_client_session(honest) as session:
        fetch_spec(session, RUN, START_SECONDS)
    strangers = {
        "none": BusConfig(listen=learner.endpoint.replace("tls/", "tcp/")),
        "of another authority": BusConfig(listen=learner.endpoint, **_files(other, "desk")),
        "expired": BusConfig(listen=learner.endpoint, **_files(late, "desk")),
        "of another host": BusConfig(listen=learner.endpoint, **_files(pki, "desk")),
    }
    forged = encode(Delivery("lab-0", 1, 0, episode_report()))
    let_in = []
    for _ in range(knocks):
        for kind, bus in strangers.items():
            # A stranger does not look at its own certificate first, as every process of ours does.
            with patch("common.bus.tls.check_certificate"), open_client_session(bus) as session:
                if ask(session, f"hd/{RUN}/experience/lab-0", 1.0, forged):
                    let_in.append(kind)
                if kind != "of another host" and _hears(session):
                    let_in.append(kind)
    began = time.monotonic()
    acks = learner.folder / "acknowledged"
    orders = Orders(honest, str(acks), "lab", messages=30)
    actors = Actors("honest", orders)
    try:
        joined = actors.finish(60.0)["longest_wait"]
    finally:
        actors.end()
    stored = len(acks.read_text("ascii").splitlines())
    seen = f"{4 * knocks} strangers, {len(let_in)} let in; then the right one: {joined:.1f} s to its first answer"
    wrong = [f"let in: {', '.join(sorted(set(let_in)))}"] if let_in else []
    if stored < 30:
        wrong.append(f"only {stored} of 30 messages were acknowledged in {time.monotonic() - began:.0f} s")
    if "Traceback" in learner.log.read_text("utf-8"):
        wrong.append("a raw traceback")
    fault = "certificates: none, of another authority, expired, of another host"
    expected = "nothing is stored or told; the right one joins"
    return Row(fault, expected, seen, stored, 0, 0, None, "; ".join(wrong))


def _hears(session) -> bool:  # type: ignore[no-untyped-def]
    try:
        return bool(fetch_spec(session, RUN, 0.5))
    except BusError:
        return False


def _files(folder: Path, name: str) -> dict[str, str]:
    return {
        "tls_ca": str(folder / "ca.pem"),
        "tls_certificate": str(folder / f"{name}.pem"),
        "tls_key": str(folder / f"{name}.key"),
    }


def _expired(pki: Path, folder: Path) -> None:
    """Make a certificate of the right authority and name that ended yesterday."""
    authority = trustme.CA.from_pem((pki / "ca.pem").read_bytes(), (pki / "ca.key").read_bytes())
    yesterday = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=1)
    issued = authority.issue_cert(
        "desk", common_name="desk", not_before=yesterday - datetime.timedelta(days=9), not_after=yesterday
    )
    (folder / "ca.pem").write_bytes((pki / "ca.pem").read_bytes())
    (folder / "desk.pem").write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
    (folder / "desk.key").write_bytes(issued.private_key_pem.bytes())
