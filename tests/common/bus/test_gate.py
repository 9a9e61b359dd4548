"""The gate before the TLS port, with real certificates and strangers who have none."""

import os
import signal
import socket
import ssl
import struct
import threading
import time

import psutil
import pytest

from common.bus.session import open_client_session, open_learner_session
from common.bus.spec import SpecServer, fetch_spec
from common.config import BusConfig
from common.errors import BusError
from common.messages.replies import Spec
from learner.certificates import write_pki
from tests.common.bus.processes import eventually, free_port, python


@pytest.fixture(scope="module")
def pki(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pki")
    write_pki(folder, [], ["desk"], [])
    return folder


def config(pki, name, port):
    files = {f"tls_{what}": str(pki / f"{name}.{end}") for what, end in (("certificate", "pem"), ("key", "key"))}
    return BusConfig(listen=f"tls/127.0.0.1:{port}", tls_ca=str(pki / "ca.pem"), **files)


@pytest.fixture
def port(pki):
    """Port of a learner with TLS, which answers with its specification."""
    port = free_port()
    with open_learner_session(config(pki, "learner", port)) as session, SpecServer(session, Spec("run", 1, "{}")):
        yield port


def join(pki, port, timeout=10.0):
    """Seconds that an actor with a certificate takes to join."""
    began = time.monotonic()
    with open_client_session(config(pki, "desk", port)) as session:
        assert fetch_spec(session, "run", timeout).run == "run"
    return time.monotonic() - began


def hello():
    """The first message of a TLS client."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    outgoing = ssl.MemoryBIO()
    with pytest.raises(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), outgoing).do_handshake()
    return outgoing.read()


def knock(port, data=b"", reset=False):
    with socket.create_connection(("127.0.0.1", port), 5.0) as stranger:
        if reset:
            stranger.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        stranger.sendall(data)


@pytest.mark.parametrize("manner", ["close", "reset", "words", "hello"])
def test_strangers_who_knock_and_go_keep_nobody_out(pki, port, manner):
    """Zenoh's own listener rests for 100 ms after each of them: 300 of them for half a minute."""
    data = {"words": b"GET / HTTP/1.0\r\n\r\n", "hello": hello()}.get(manner, b"")
    for _ in range(300):
        knock(port, data, manner == "reset")
    assert join(pki, port) < 5.0


def test_strangers_who_keep_knocking_keep_nobody_out(pki, port):
    done = threading.Event()

    def stranger():
        data = hello()
        while not done.wait(0.05):
            with socket.create_connection(("127.0.0.1", port), 5.0) as connection:
                connection.sendall(data)
                time.sleep(0.03)  # so long that Zenoh has answered

    thread = threading.Thread(target=stranger)
    thread.start()
    try:
        time.sleep(2.0)
        assert all(join(pki, port) < 5.0 for _ in range(3))
    finally:
        done.set()
        thread.join()


def test_strangers_who_come_and_say_nothing_keep_nobody_out(pki, port):
    silent = [socket.create_connection(("127.0.0.1", port), 5.0) for _ in range(600)]
    assert join(pki, port) < 5.0
    for each in silent:
        each.close()


def test_a_gate_that_dies_is_started_again_and_actors_come_back(pki, port):
    with open_client_session(config(pki, "desk", port)) as session:
        assert fetch_spec(session, "run", 10.0).run == "run"
        (gate,) = [
            child
            for child in psutil.Process().children()
            if "common.bus.gate" in child.cmdline() and child.is_running()
        ]
        os.kill(gate.pid, signal.SIGKILL)
        time.sleep(0.2)
        assert fetch_spec(session, "run", 20.0).run == "run"


def test_a_taken_port_is_told(pki, port):
    with (
        pytest.raises(BusError, match="in use by another process"),
        open_learner_session(config(pki, "learner", port)),
    ):
        pass


def test_the_port_is_free_once_its_learner_is_killed(pki):
    port = free_port()
    code = """
import sys
from common.bus.session import open_learner_session
from common.config import BusConfig
with open_learner_session(BusConfig.model_validate_json(sys.argv[1])):
    print("ready", flush=True)
    sys.stdin.read()
"""
    with python(code, config(pki, "learner", port).model_dump_json()) as process:
        assert process.stdout.readline() == "ready\n"
        process.kill()
        process.wait()

    def free():
        try:
            socket.create_server(("127.0.0.1", port)).close()
        except OSError:
            return False
        return True

    assert eventually(free, 5.0)
