"""When a bridge hears signals: in its preparation, while it runs, and while it closes."""

import signal

import pytest

from common.system.entry import ended_by_signals
from deploy.bridge import process
from deploy.config import DeployConfig

CONFIG = DeployConfig()


class FakeBridge:
    """Gets a SIGTERM at one moment of its life."""

    when = "prepare"
    happened: list[str]

    def __init__(self, config):
        self.happened.append("prepare")
        self._reach("prepare")

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def run(self, stop):
        self.happened.append("run")
        self._reach("run")
        assert stop.is_set() == (self.when == "run")

    def close(self):
        if "closed" in self.happened:
            return
        self.happened.append("close")
        self._reach("close")
        self.happened.append("closed")

    def _reach(self, moment):
        if moment == self.when:
            signal.raise_signal(signal.SIGTERM)


@pytest.fixture(params=["prepare", "run", "close"])
def fake(request, monkeypatch):
    monkeypatch.setattr(FakeBridge, "when", request.param)
    monkeypatch.setattr(FakeBridge, "happened", [], raising=False)
    monkeypatch.setattr(process, "Bridge", FakeBridge)
    before = signal.getsignal(signal.SIGTERM)
    yield FakeBridge
    signal.signal(signal.SIGTERM, before)


def test_a_signal_breaks_off_what_prepares_a_bridge_and_nothing_later(fake):
    if fake.when == "prepare":
        with pytest.raises(SystemExit), ended_by_signals():
            process.run_bridge(CONFIG)
        assert fake.happened == ["prepare"]
    else:
        with ended_by_signals():
            process.run_bridge(CONFIG)
        assert fake.happened == ["prepare", "run", "close", "closed"]
