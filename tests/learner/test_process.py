"""The learner as a real process on a real bus."""

import json
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from common.bus.experience import ExperienceSender
from common.bus.query import ask
from common.bus.session import open_client_session
from common.bus.weights import WeightsPuller
from common.config import BusConfig
from common.messages.experience import Delivery
from common.messages.schema import encode
from common.messages.stats import LearnerStats
from tests.learner.experience import episode_report
from tests.learner.runs import episodes
from tests.rigs.learner import Learner, until


@pytest.fixture
def learner(tmp_path):
    made = Learner(tmp_path)
    yield made
    made.end()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_kill_at_any_moment_loses_nothing_and_counts_nothing_twice(learner):
    random.seed(3)
    made = episodes(60)
    with (
        open_client_session(BusConfig(), [learner.endpoint]) as session,
        ExperienceSender(session, "test", "desk-0", buffer=1000, ack_timeout=1.0) as sender,
    ):
        learner.launch("start")
        for part in range(3):
            for delivery in made[part * 60 : part * 60 + 60]:
                sender.send(delivery.body)
                time.sleep(0.002)
            goal = part * 60 + random.randrange(5, 50)
            assert until(lambda goal=goal: sender.acknowledged >= goal), learner.log.read_text()
            time.sleep(random.uniform(0.0, 0.5))  # checkpoints are written three times a second
            learner.kill()
            learner.launch("resume")
        assert sender.flush(60.0), learner.log.read_text()
        assert (sender.acknowledged, sender.refused) == (180, 0)
        status = learner.status()
    assert status["steps"] == 60 * 8
    assert status["episodes"] == 60
    lines = (learner.folder / "runs" / "test" / "episodes.jsonl").read_text().splitlines()
    assert sorted(json.loads(line)["distance"] for line in lines) == [100.0 + i for i in range(60)]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_strangers_disturb_no_run(learner):
    """Each of these once silenced the status, ended the run, or chose its best policy."""
    made, bad = episodes(6), episodes(1)[0].body
    bad.rewards[1] = 3e38
    report = episode_report("evaluate", 9, map_name="invented", distance=0.0)
    stats = LearnerStats("x", 1, 1, 1, 1, 1, 1.0, 1.0, 1, "training")
    learner.launch("start")
    with open_client_session(BusConfig(), [learner.endpoint]) as session:
        with ExperienceSender(session, "test", "desk-0") as sender:
            for delivery in made:
                sender.send(delivery.body)
            assert sender.flush(60.0), learner.log.read_text()
            sender.send(bad)
            assert sender.flush(60.0)
            assert sender.refused == 1
        session.put("hd/test/stats/actor/desk-0", encode(stats))
        for number in range(50):
            ask(session, f"hd/test/experience/evil-{number}", 5.0, encode(Delivery(f"evil-{number}", 1, 0, report)))
        tokens = [session.liveliness().declare_token(f"hd/test/live/actor/wide-{number}") for number in range(1300)]
        # A second of statistics, and a state of the learner for each command.
        time.sleep(1.5)
        status = learner.status()
        assert len(status["actors"]) >= 1300
        assert (status["steps"], status["best"], status["refused"]) == (48, -1, 1)
        assert json.loads(learner.ask("status", "--json"))["state"] != "stopping"
        for token in tokens:
            token.undeclare()
    learner.ask("stop")
    assert learner.process.wait(60) == 0, learner.log.read_text()
    assert "Traceback" not in learner.log.read_text()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_run_from_start_to_stop_by_its_commands(learner):
    made = episodes(20)
    learner.launch("start")
    with (
        open_client_session(BusConfig(), [learner.endpoint]) as session,
        ExperienceSender(session, "test", "desk-0") as sender,
        WeightsPuller(session, "test") as puller,
    ):
        assert puller.wait(60.0) is not None, learner.log.read_text()
        for delivery in made:
            sender.send(delivery.body)
        assert sender.flush(60.0)
        assert until(lambda: learner.status()["updates"] == 8)  # 160 steps at 0.05
        assert puller.latest().version >= 1
        assert learner.status()["ratio_actual"] == pytest.approx(0.05)
        assert "is paused at 8 updates" in learner.ask("pause")
        assert learner.status()["state"] == "paused"
        assert "continues from 8 updates" in learner.ask("unpause")
        assert "checkpoint 000000008 written" in learner.ask("checkpoint")
        assert "HDPlanner test" in learner.ask("status")
        refused = learner.run("start", "--run", "test")
        assert refused.returncode == 1
        assert "exists already" in refused.stderr and "--overwrite" in refused.stderr
        busy = learner.run("resume", "--run", "test")
        assert busy.returncode == 1 and "stop it first" in busy.stderr
        assert "stops after 8 updates" in learner.ask("stop")
        assert learner.process.wait(20.0) == 0
    done = learner.run("export", "--run", "test")
    assert done.returncode == 0 and "exploration policy, version" in done.stdout
    assert (learner.folder / "test.safetensors").is_file() and (learner.folder / "test.json").is_file()
    learner.launch("resume")
    assert until(lambda: "resumed run test from checkpoint 000000008: 8 updates, 160 steps" in learner.log.read_text())
    assert until(lambda: "listens on" in learner.log.read_text().rsplit("resumed run", 1)[1])
    learner.process.send_signal(signal.SIGTERM)
    assert learner.process.wait(20.0) == 0


@pytest.mark.slow
def test_a_taken_port_is_one_clear_line(learner):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = learner.run("start", "--run", "other", "--listen", endpoint)
    assert done.returncode == 1
    assert "is in use by another process" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_start_that_failed_or_was_interrupted_blocks_no_later_one(learner):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        for listen, words in ((endpoint, "is in use"), ("tcp/nowhere", "an endpoint must be")):
            done = learner.run("start", "--run", "test", "--listen", listen)
            assert done.returncode == 1 and words in done.stderr and "Traceback" not in done.stderr
    learner.launch("start")
    assert until(lambda: "preparing the kernels" in learner.log.read_text())
    time.sleep(0.5)
    learner.process.send_signal(signal.SIGINT)
    assert learner.process.wait(60.0) == 130, learner.log.read_text()
    assert "Traceback" not in learner.log.read_text()
    # The one that `make run` gives, and any other, continues where there is nothing to continue with.
    learner.launch("resume")
    assert until(lambda: "has no checkpoint yet: starting over" in learner.log.read_text())
    assert until(lambda: "listens on" in learner.log.read_text()), learner.log.read_text()
    assert learner.status()["state"] == "collecting"


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_second_learner_of_a_run_on_one_network_is_refused(learner):
    learner.launch("start")
    assert until(lambda: learner.log.is_file() and "listens on" in learner.log.read_text())
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{found.getsockname()[1]}"
    connect = ("--listen", endpoint, "--set", f"bus.connect={learner.endpoint}", "--runs", "elsewhere")
    done = learner.run("start", "--run", "test", *connect)
    assert done.returncode == 1
    assert "another learner of run 'test' works on this network: stop it first" in done.stderr
    assert "Traceback" not in done.stderr
    assert learner.status()["run"] == "test"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux for a signal at the parent's death")
def test_a_tethered_command_ends_with_its_killed_parent():
    program = (
        "import os, subprocess, sys, time\n"
        "command = [sys.executable, '-m', 'common.system.tethered', str(os.getpid()), sys.executable, '-c',"
        " 'import time; time.sleep(60)']\n"
        "sys.stdout.write(f'{subprocess.Popen(command).pid}\\n')\n"
        "sys.stdout.flush()\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    assert until(lambda: b"time.sleep(60)" in command_line(child), 20.0)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    assert until(lambda: not command_line(child), 20.0) is True


def command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def test_local_actors_reach_a_learner_that_listens_everywhere():
    from learner.local_actors import local_endpoint

    assert local_endpoint("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"
    assert local_endpoint("tcp/192.168.1.5:7447") == "tcp/192.168.1.5:7447"
