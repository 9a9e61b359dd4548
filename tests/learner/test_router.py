"""Actors of a site reach the learner through a router, which may come and go, and which knows whose messages pass."""

import contextlib
import subprocess
import sys

import numpy as np
import pytest

from common.bus.experience import ExperienceSender, ExperienceServer
from common.bus.query import ask
from common.bus.session import open_client_session, open_learner_session
from common.config import BusConfig
from common.messages.experience import Delivery, End
from common.messages.replies import Ack
from common.messages.schema import decode, encode
from learner.certificates import write_pki
from tests.common.bus.processes import ROOT, eventually, free_port, loopback
from tests.learner.experience import episode_chunks, episode_report, observation_pool


@contextlib.contextmanager
def router(listen: str, connect: str, *settings: str):
    command = [sys.executable, "-m", "learner", "router", "--listen", listen, "--connect", connect]
    process = subprocess.Popen(
        [*command, *(part for each in settings for part in ("--set", each))],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
        process.terminate()
        assert process.wait(60) == 0, process.stderr.read()
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


def keep(stored: list[Delivery]):
    def store(delivery: Delivery, data: bytes) -> float:
        del data
        stored.append(delivery)
        return 0.0

    return store


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "compression", [pytest.param(False, marks=pytest.mark.slow), True], ids=["plain", "compressed"]
)
def test_deliveries_cross_a_router_that_comes_late_and_comes_back(compression):
    bus = loopback(compression=compression)
    site = f"tcp/127.0.0.1:{free_port()}"
    settings = ["bus.compression=true"] if compression else []
    stored: list[Delivery] = []
    with open_learner_session(bus) as session, ExperienceServer(session, "test", 1, keep(stored)):
        client = BusConfig(compression=compression)
        with (
            open_client_session(client, [site]) as far,
            ExperienceSender(far, "test", "desk-0", ack_timeout=1.0) as sender,
        ):
            sender.send(episode_report())
            with router(site, bus.listen, *settings):
                chunk = episode_chunks(
                    np.random.default_rng(0), observation_pool(viewpoints=(100, 150)), 8, 8, End.TERMINAL
                )
                sender.send(chunk[0])
                assert eventually(lambda: sender.acknowledged == 2, 120.0)
            sender.send(episode_report())
            with router(site, bus.listen, *settings):
                assert eventually(lambda: sender.acknowledged == 3, 120.0)
    assert sorted({delivery.sequence for delivery in stored}) == [0, 1, 2]


@pytest.mark.timeout(120)
def test_a_router_that_finds_nobody_says_so_once_and_goes_on():
    nobody = f"tcp/127.0.0.1:{free_port()}"
    with router(f"tcp/127.0.0.1:{free_port()}", nobody) as process:
        said = next(line for line in process.stderr if "nobody answers" in line)
        assert nobody in said
        assert process.poll() is None


@pytest.mark.timeout(300)
def test_the_access_rules_of_the_run_hold_at_the_router(tmp_path):
    write_pki(tmp_path, [], ["desk", "lab"], [])

    def files(name: str) -> dict[str, str]:
        parts = {"tls_ca": "ca.pem", "tls_certificate": f"{name}.pem", "tls_key": f"{name}.key"}
        return {key: str(tmp_path / value) for key, value in parts.items()}

    access = str(tmp_path / "access.json")
    bus = BusConfig(listen=f"tls/127.0.0.1:{free_port()}", tls_access=access, **files("learner"))
    site = f"tls/127.0.0.1:{free_port()}"
    rules = [f"bus.{key}={value}" for key, value in {**files("learner"), "tls_access": access}.items()]
    stored: list[Delivery] = []
    with (
        open_learner_session(bus) as session,
        ExperienceServer(session, "test", 1, keep(stored)),
        router(site, bus.listen, *rules),
        open_client_session(BusConfig(**files("desk")), [site]) as far,
    ):

        def delivered(actor: str) -> bool:
            replies = ask(far, f"hd/test/experience/{actor}", 2.0, encode(Delivery(actor, 1, 0, episode_report())))
            return any(reply.ok and decode(reply.ok.payload.to_bytes(), Ack).stored for reply in replies)

        assert eventually(lambda: delivered("desk-0"), 120.0)
        assert not delivered("lab-0")
    assert {delivery.actor for delivery in stored} == {"desk-0"}
