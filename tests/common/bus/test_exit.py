"""How processes end: cleanly, by an error, by a signal, or with everything left open."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest

from tests.common.bus.processes import ROOT, loopback

# Everything that a process can have open; `close` says how it ends.
WHOLE = """
import os, signal, sys, time
from common.bus.control import ControlServer
from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.liveness import PresenceWatcher, declare_presence
from common.bus.session import open_client_session, open_learner_session
from common.bus.spec import SpecServer
from common.bus.stats import StatsTable
from common.bus.weights import WeightsPublisher, WeightsPuller
from common.config import BusConfig
from common.messages.replies import Spec
from contextlib import ExitStack
from common.messages.experience import EpisodeReport
from common.messages.weights import Weights

# One process has everything imported; what ends are copies of it, made before anything is open.
children = {}
for listen, role, end in zip(*(sys.argv[first::3] for first in (1, 2, 3))):
    ready, tell = os.pipe()
    child = os.fork()
    if not child:
        os.dup2(tell, 1)
        break
    os.close(tell)
    children[child] = ready, role, end
else:
    for child, (ready, role, end) in children.items():
        status = os.waitpid(child, 0)[1]
        print(role, end, os.read(ready, 100).decode().strip(), os.waitstatus_to_exitcode(status), flush=True)
    sys.exit()

# A shell that starts its jobs in the background lets them ignore the interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
report = EpisodeReport("exploration", "rooms-7", "grid", "train", "policy", 3, 41, 260.5, True, 1.0, 12.5, 0, 3.5)
weights = Weights.of({}, learner=1, version=1, updates=1)
config = BusConfig(listen=listen)
stack = ExitStack()
enter = stack.enter_context
def begin():
    global things, session
    if role == "learner":
        session = enter(open_learner_session(config))
        things = [
            enter(declare_presence(session, "run", "learner", "learner")),
            enter(PresenceWatcher(session, "run")),
            enter(ExperienceServer(session, "run", 1, lambda delivery, payload: 0.0)),
            enter(WeightsPublisher(session, "run")),
            enter(SpecServer(session, Spec("run", 1, "{}"))),
            enter(ControlServer(session, "run", lambda command: {})),
            enter(StatsTable(session, "run")),
        ]
        things[3].publish(weights)
    else:
        session = enter(open_client_session(config))
        things = [
            enter(declare_presence(session, "run", "actor", "desk-0")),
            enter(ExperienceSender(session, "run", "desk-0")),
            enter(WeightsPuller(session, "run")),
        ]
        things[1].send(report)
    time.sleep(0.2)
    print("ready", flush=True)

if end == "forgotten":
    begin()
elif end == "error":
    with stack:
        begin()
        raise RuntimeError("wanted")
elif end == "exit":
    with stack:
        begin()
        sys.exit(3)
elif end == "interrupt":
    with stack:
        begin()
        signal.raise_signal(signal.SIGINT)
else:
    with stack:
        begin()
"""


CODES = {"normal": 0, "error": 1, "exit": 3, "interrupt": -signal.SIGINT, "forgotten": 0}
QUICK = [("learner", "forgotten"), ("learner", "error"), ("actor", "forgotten"), ("actor", "interrupt")]


@pytest.mark.parametrize(
    "ways",
    [
        pytest.param(QUICK, id="the worst"),
        pytest.param([(role, end) for role in ("learner", "actor") for end in CODES], id="all", marks=pytest.mark.slow),
    ],
)
def test_processes_end_whatever_way_they_end(ways):
    """No way of ending hangs: not even leaving everything open."""
    arguments = [word for role, end in ways for word in (loopback().listen, role, end)]
    process = subprocess.Popen(
        [sys.executable, "-c", WHOLE, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=60)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert output.splitlines() == [f"{role} {end} ready {CODES[end]}" for role, end in ways]
