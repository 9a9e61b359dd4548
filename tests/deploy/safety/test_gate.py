import os
import select
import signal
import subprocess
import sys

import pytest

from common.errors import ConfigError
from deploy.config import DeployConfig
from deploy.network_config import RosConfig
from deploy.ros2 import Node
from deploy.safety.channel import Channel
from deploy.safety.gate import SafetyError, VelocityGate, WatchdogProcess, behind_watchdog
from deploy.safety.gate_state import GateMode
from tests.common.bus.processes import eventually, free_port


def test_packets_arrive_whole_and_in_order():
    one, other = Channel.pair()
    with one, other:
        assert other.receive() == []
        for number in range(3):
            assert one.send(number=number, text="é")
        assert other.receive() == [{"number": number, "text": "é"} for number in range(3)]


def test_packets_before_the_end_are_not_lost():
    one, other = Channel.pair()
    with other:
        one.send(kind="finish")
        one.close()
        assert other.receive() == [{"kind": "finish"}]
        with pytest.raises(EOFError):
            other.receive()
        assert not other.send(kind="late")


def test_last_words_arrive_though_the_other_end_was_closed_unread():
    one, other = Channel.pair()
    with other:
        other.send(kind="beat")
        one.send(failed="no")
        one.close()
        assert other.receive() == [{"failed": "no"}]
        with pytest.raises(EOFError):
            other.receive()


def test_full_channel_drops_and_never_blocks():
    one, other = Channel.pair()
    with one, other:
        sent = sum(one.send(number=number, text="x" * 1000) for number in range(3000))
        assert 0 < sent < 3000
        assert len(other.receive()) == sent


def test_death_of_the_other_process_is_seen_at_once():
    ours, theirs = Channel.pair()
    with ours:
        with theirs:
            command = [sys.executable, "-c", "import sys; sys.stdin.read()"]
            process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=[theirs.fileno()])
        assert not select.select([ours], [], [], 0.2)[0]
        process.kill()
        assert select.select([ours], [], [], 5.0)[0]
        with pytest.raises(EOFError):
            ours.receive()
        process.wait()
        process.stdin.close()


@pytest.mark.parametrize(
    ("listen", "connect"),
    [
        (("tcp/0.0.0.0:7447",), ("tcp/127.0.0.1:7447", "tcp/10.0.0.2:7447")),
        (("tcp/[::]:7447",), ("tcp/[::1]:7447", "tcp/10.0.0.2:7447")),
        (("tcp/192.168.1.5:7447",), ("tcp/192.168.1.5:7447", "tcp/10.0.0.2:7447")),
    ],
)
def test_bridge_connects_to_where_its_watchdog_listens(listen, connect):
    ros = behind_watchdog(RosConfig(listen=listen, connect=("tcp/10.0.0.2:7447",)))
    assert (ros.listen, ros.connect) == ((), connect)


def test_bridge_that_does_not_listen_keeps_its_settings():
    assert behind_watchdog(RosConfig()) == RosConfig()


@pytest.mark.parametrize(
    ("topics", "driving", "words"),
    [({"velocity": "", "stop": ""}, False, "both empty"), ({"velocity": "", "stop": "/stop"}, True, "topics.velocity")],
)
def test_robot_that_cannot_be_stopped_is_refused(topics, driving, words):
    with pytest.raises(ConfigError, match=words):
        VelocityGate(DeployConfig(topics=topics, driving={"enabled": driving}))


def test_reason_of_a_watchdog_that_cannot_start_is_told():
    config = DeployConfig(ros={"connect": (f"tcp/127.0.0.1:{free_port()}",), "tls_ca": "/nowhere/ca.pem"})
    with pytest.raises(SafetyError, match=r"tls_ca: no file '/nowhere/ca.pem'"):
        VelocityGate(config)


def test_a_process_that_was_started_before_is_the_watchdog_and_does_nothing_until_then():
    config = DeployConfig(ros=RosConfig(listen=(f"tcp/127.0.0.1:{free_port()}",), connect=()))
    with WatchdogProcess() as process:
        assert process.channel.receive() == []
        with VelocityGate(config, process) as gate:
            assert gate.pid == process.process.pid
            assert gate.state.alive
    with WatchdogProcess() as unused:
        pass
    assert unused.process.returncode is not None


def test_a_stop_is_told_from_the_moment_it_is_latched_and_not_only_when_the_watchdog_says_so():
    config = DeployConfig(ros=RosConfig(listen=(f"tcp/127.0.0.1:{free_port()}",), connect=()))
    with VelocityGate(config) as gate:
        os.kill(gate.pid, signal.SIGSTOP)
        assert not gate.state.emergency_stop
        gate.emergency_stop("smoke in the hall")
        assert gate.latched
        assert gate.state.emergency_stop
        assert gate.state.mode is GateMode.EMERGENCY_STOP
        assert gate.state.reason == "emergency stop (smoke in the hall) until it is released"
        os.kill(gate.pid, signal.SIGCONT)
        gate.release()
        assert eventually(lambda: not gate.latched, 10.0)
        assert gate.state.mode is not GateMode.EMERGENCY_STOP


def test_a_bridge_that_cannot_publish_still_replaces_a_dead_watchdog():
    config = DeployConfig(ros=RosConfig(listen=(f"tcp/127.0.0.1:{free_port()}",), connect=()))
    with VelocityGate(config) as gate:
        with Node(behind_watchdog(config.ros), "bridge") as node:
            gate.use_when_watchdog_dies(node)
        # What the bridge would stop the robot with is closed now, as in the moment of its own end.
        dead = gate.pid
        os.kill(dead, signal.SIGKILL)
        assert eventually(lambda: gate.pid != dead and gate.state.alive, 60.0)
