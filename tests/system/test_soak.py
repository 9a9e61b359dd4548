"""The soak in short: a robot under physics, a real bridge and bus, and nine things that fail one after the other."""

import socket
import threading

import pytest

pytest.importorskip("pybullet", reason="PyBullet is not installed")

from rich.console import Console

from benchmarks.link import Link
from benchmarks.soak import growth, soak, table
from benchmarks.soak_faults import FAULTS
from benchmarks.soak_rig import Rig
from benchmarks.soak_robot import Motion, standstill, way
from deploy.robot.options import RobotOptions


def motions(speeds):
    return [Motion(0.1 * n, 0.1 * sum(speeds[:n]), speed, 0.0) for n, speed in enumerate(speeds)]


def test_a_robot_stands_only_when_it_stays():
    assert standstill(motions([1.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0])).time == pytest.approx(0.5)
    assert standstill(motions([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])) is None
    assert way(motions([1.0] * 6)) == pytest.approx(0.5)


def test_growth_is_that_after_the_first_minutes():
    samples = [(float(second), 100_000_000 + (0 if second < 100 else 50_000_000)) for second in range(300)]
    assert growth(samples) == 0.0
    assert growth([(at, size + 1000 * at) for at, size in samples]) == pytest.approx(150_000, rel=0.1)
    assert growth(samples[:100]) is None


def test_a_cut_link_keeps_what_is_sent_and_a_dropped_one_ends():
    with socket.create_server(("127.0.0.1", 0)) as server, Link(f"tcp/127.0.0.1:{server.getsockname()[1]}") as link:
        near = socket.create_connection(("127.0.0.1", int(link.endpoint.rpartition(":")[2])))
        far, _ = server.accept()
        with near, far:
            near.sendall(b"one")
            assert far.recv(3) == b"one"
            link.cut()
            near.sendall(b"two")
            far.settimeout(0.3)
            with pytest.raises(TimeoutError):
                far.recv(3)
            threading.Timer(0.1, link.mend).start()
            far.settimeout(5.0)
            assert far.recv(3) == b"two"
            link.drop()
            near.settimeout(5.0)
            assert near.recv(1) == b"" and far.recv(1) == b""


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_whatever_fails_the_robot_stands_in_time_and_touches_nothing(tmp_path):
    with Rig(RobotOptions(range_noise=0.02), tmp_path) as rig:
        rows = soak(rig, 1.7, 10.0, FAULTS[:9])
        collisions = rig.robot.collisions
    Console(width=240).print(table(rows))
    assert len(rows) >= 6
    assert [row.wrong for row in rows if row.wrong] == []
    assert collisions == 0
