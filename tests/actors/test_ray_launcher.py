"""`hd-actor --launcher ray` on a cluster that consists of this machine."""

import importlib.util
import os
import re
import signal
import sys

import psutil
import pytest

from actors.ray_launcher import RayLauncher
from common.errors import ConfigError
from tests.actors.command import Command, gone
from tests.actors.learner_end import LearnerEnd, free_port


def places():
    """Process numbers of the actors of the cluster and of the places that they run in, by name."""
    found = {}
    for process in psutil.process_iter(["cmdline"]):
        line = " ".join(process.info["cmdline"] or ())
        name = re.search(r'"name":"(cloud-[0-9]+)"', line)
        if "actors.process" in line and name:
            found[name[1]] = process.pid, process.ppid()
    return found


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed (extra: ray)")
def test_ray_places_actors_and_places_them_again():
    with (
        LearnerEnd(free_port()) as learner,
        Command("--num", "2", "--launcher", "ray", "--connect", learner.endpoint, "--name", "cloud") as command,
    ):
        both = {"cloud-0", "cloud-1"}
        assert learner.wait_for(lambda: {d.actor for d in learner.deliveries} == both, 200), command.output
        first = {d.actor: d.incarnation for d in learner.deliveries}
        # An actor dies, and the place of another one, as when its machine is lost.
        actor, _ = places()["cloud-0"]
        orphan, place = places()["cloud-1"]
        os.kill(actor, signal.SIGKILL)
        os.kill(place, signal.SIGKILL)
        assert gone(orphan)
        assert learner.wait_for(
            lambda: both == {d.actor for d in learner.deliveries if d.incarnation != first[d.actor]}, 100
        ), command.output
        assert "cloud-0 was killed by SIGKILL" in command.output
        assert "cloud-1 lost its place in the Ray cluster" in command.output
        children = places()
        command.process.send_signal(signal.SIGINT)
        assert command.wait(20) == 0, command.output
        assert all(gone(pid) for pair in children.values() for pid in pair)


def test_what_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match=r"--launcher ray needs the package ray.*\[ray\].*use --launcher local"):
        RayLauncher(None)
