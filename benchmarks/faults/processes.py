"""Processes and links that fail: killed, frozen, cut, broken off, slow, lossy, narrow."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator

from benchmarks.faults.rig import FaultError, Rig
from benchmarks.faults.table import Row
from benchmarks.link import Link

logger = logging.getLogger(__name__)


def judged(
    rig: Rig,
    fault: str,
    expected: str,
    seen: str,
    log: str,
    resumes: float | None,
    *problems: str,
    within: float = 30.0,
) -> Row:
    """Make the row of a fault that is over.

    Args:
        rig: that it was tried on.
        fault: in words.
        expected: in words.
        seen: in words.
        log: what the learner said meanwhile.
        resumes: seconds until the next acknowledgement, None if it did not come.
        problems: other things that were wrong, empty ones not counted.
        within: seconds in which delivery has to continue.
    """
    acknowledged, lost, doubled = rig.books()
    wrong = [problem for problem in problems if problem]
    if lost or doubled:
        wrong.append("the books are wrong")
    if resumes is None or resumes > within:
        wrong.append(f"did not resume within {within:g} s")
    if "Traceback" in log:
        wrong.append("a raw traceback")
    if wrong:
        logger.warning("what the learner said during '%s':\n%s", fault, log[-5000:])
    return Row(fault, expected, seen, acknowledged, lost, doubled, resumes, "; ".join(wrong))


def kill(rig: Rig, times: int) -> Row:
    """Kill the learner in the middle of its work and resume its run, again and again."""
    longest = 0.0
    with rig.said() as said:
        for number in range(times):
            time.sleep(0.7 * number % 2.0)
            rig.learner.kill()
            since = time.monotonic()
            rig.learner.launch("resume")
            resumes = rig.resumed(since, 100.0)
            if resumes is None:
                break
            longest = max(longest, resumes)
    seen = f"resumed {said[0].count('resumed run')} times"
    problem = "" if said[0].count("resumed run") == times else "not each resumed"
    fault = f"the learner is killed (SIGKILL), {times} times"
    return judged(rig, fault, "resumes, with the start of a process", seen, said[0], longest, problem, within=60.0)


def freeze(rig: Rig, seconds: float) -> Row:
    """Stop the learner for a while."""
    with rig.said() as said:
        rig.learner.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        rig.learner.process.send_signal(signal.SIGCONT)
        since = time.monotonic()
        resumes = rig.resumed(since)
    expected = "actors wait and deliver again"
    return judged(rig, f"the learner hangs (SIGSTOP) for {seconds:g} s", expected, "as expected", said[0], resumes)


def cut(rig: Rig, seconds: float) -> Row:
    """Let nothing through for a while; what is sent waits."""
    with rig.said() as said:
        rig.link.cut()
        time.sleep(seconds)
        rig.link.mend()
        since = time.monotonic()
        resumes = rig.resumed(since)
    fault = f"the link is cut for {seconds:g} s"
    return judged(rig, fault, "actors join again", "as expected", said[0], resumes)


def broken_off(rig: Rig, times: int) -> Row:
    """Break all connections off, as a switch that starts again does."""
    longest = 0.0
    with rig.said() as said:
        for _ in range(times):
            rig.link.drop()
            since = time.monotonic()
            resumes = rig.resumed(since + 0.02)
            longest = max(longest, resumes if resumes is not None else float("inf"))
            time.sleep(0.3)
    fault = f"all connections break off, {times} times"
    return judged(rig, fault, "actors join again", "as expected", said[0], longest)


@contextlib.contextmanager
def link_with(rig: Rig, *, delay: float = 0.0, loss: float = 0.0) -> Iterator[None]:
    """Make the link slow or lossy for the time of a `with`."""
    rig.link.delay, rig.link.loss = delay, loss
    try:
        yield
    finally:
        rig.link.delay = rig.link.loss = 0.0


def slow(rig: Rig, delay: float, loss: float, seconds: float) -> Row:
    """Delay everything, or lose packets, for a while: delivery continues."""
    with rig.said() as said, link_with(rig, delay=delay, loss=loss):
        time.sleep(0.5)
        before = len(rig.acknowledged())
        # The longest pause between two acknowledgements is what the fault costs.
        began = time.monotonic()
        time.sleep(seconds)
        moments = sorted(moment for moment in rig.acknowledged().values() if moment >= began)
    ends = [began, *moments, time.monotonic()]
    pause = max(b - a for a, b in itertools.pairwise(ends))
    rate = (len(rig.acknowledged()) - before) / seconds
    fault = f"a slow link: {1e3 * delay:.0f} ms each way" if delay else f"a lossy link: {loss:.0%} of the packets"
    seen = f"{rate:.0f} messages/s"
    problem = "" if moments else "nothing was delivered"
    return judged(rig, fault, "delivery continues", seen, said[0], pause, problem, within=seconds)


def narrow(rig: Rig, kilobits: int, seconds: float) -> Row:
    """Let an actor of another network namespace deliver through a line that drops what it cannot carry."""
    fault = f"a narrow line between two network namespaces: {kilobits} kbit/s, drops beyond 6 kB"
    try:
        with rig.said() as said, namespace(kilobits) as (prefix, address, dropped):
            with _forwarded(rig, address) as endpoint:
                orders = rig.orders("narrow", endpoint=endpoint, number=2, rate=100.0, messages=int(20 * seconds))
                since = time.monotonic()
                figures = rig.start("honest", orders, prefix).finish(60.0 + 10.0 * seconds)
                took = time.monotonic() - since
            packets = dropped()
    except FaultError as error:
        return Row(fault, "delivery continues", f"not tried: {error}", wrong="not tried")
    seen = f"{packets} packets dropped, all delivered in {took:.0f} s"
    problem = "" if packets else "no packet was dropped"
    return judged(rig, fault, "delivery continues", seen, said[0], figures["longest_wait"], problem)


@contextlib.contextmanager
def _forwarded(rig: Rig, address: str) -> Iterator[str]:
    """Give an endpoint on another address of this machine that leads to the learner."""
    with Link(rig.learner.endpoint, address) as link:
        yield link.endpoint


@contextlib.contextmanager
def namespace(kilobits: int):  # type: ignore[no-untyped-def]
    """Make a network namespace behind a narrow line; give the prefix of its commands, our address, and a counter."""
    name = f"hd{os.getpid() % 100_000}"
    near, far = f"{name}a", f"{name}b"
    narrow_line = ("root", "tbf", "rate", f"{kilobits}kbit", "burst", "2000", "limit", "6000")
    steps = [
        ("ip", "netns", "add", name),
        ("ip", "link", "add", near, "type", "veth", "peer", "name", far, "netns", name),
        ("ip", "addr", "add", "10.213.77.1/30", "dev", near),
        ("ip", "link", "set", near, "up"),
        ("ip", "netns", "exec", name, "ip", "addr", "add", "10.213.77.2/30", "dev", far),
        ("ip", "netns", "exec", name, "ip", "link", "set", far, "up"),
        ("tc", "qdisc", "add", "dev", near, *narrow_line),
        ("ip", "netns", "exec", name, "tc", "qdisc", "add", "dev", far, *narrow_line),
    ]

    def dropped() -> int:
        texts = [
            _run("tc", "-s", "qdisc", "show", "dev", near),
            _run("ip", "netns", "exec", name, "tc", "-s", "qdisc", "show", "dev", far),
        ]
        return sum(int(number) for text in texts for number in re.findall(r"dropped (\d+)", text))

    try:
        for step in steps:
            _run(*step)
        yield ("ip", "netns", "exec", name), "10.213.77.1", dropped
    finally:
        for step in (("ip", "link", "del", near), ("ip", "netns", "del", name)):
            with contextlib.suppress(FaultError):
                _run(*step)


def _run(*command: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise FaultError(f"{command[0]} is not installed") from None
    if done.returncode:
        raise FaultError(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout
