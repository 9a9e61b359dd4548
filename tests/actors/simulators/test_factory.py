import logging
import subprocess
import sys

import pytest

from actors.simulators.factory import make_simulator
from actors.simulators.grid import GridSimulator
from common.config import SimulatorConfig
from common.errors import HDError, SimulatorError
from tests.actors.simulators.worlds import RANGE, hall


def test_the_grid_simulator_imports_no_pybullet():
    code = (
        "import sys; from actors.simulators.factory import make_simulator; "
        "from common.config import SimulatorConfig; "
        "make_simulator(SimulatorConfig(name='grid'), 20.0); sys.exit('pybullet' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_missing_pybullet_says_what_to_do(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("actors.simulators.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pybullet", None)
    from actors.simulators.factory import make_simulator as fresh

    with pytest.raises(HDError, match=r"pip install .*--sim grid"):
        fresh(SimulatorConfig(), RANGE)


def test_configuration_chooses_the_simulator():
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    from actors.simulators.dynamic import DynamicSimulator
    from actors.simulators.kinematic import KinematicSimulator

    for settings, kind in (
        ({"name": "grid"}, GridSimulator),
        ({"fidelity": "kinematic"}, KinematicSimulator),
        ({"fidelity": "dynamic"}, DynamicSimulator),
    ):
        simulator = make_simulator(SimulatorConfig(**settings), RANGE)
        try:
            assert type(simulator) is kind
            simulator.reset(hall(), seed=0)
            assert simulator.scan().range_max == RANGE
        finally:
            simulator.close()


def test_pybullet_settings_for_the_grid_simulator_are_pointed_out(caplog):
    with caplog.at_level(logging.WARNING):
        make_simulator(SimulatorConfig(name="grid", fidelity="dynamic"), RANGE)
    assert "no effect" in caplog.text


def test_a_window_needs_a_display(monkeypatch):
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    if not sys.platform.startswith("linux"):
        pytest.skip("only X displays are checked beforehand")
    with pytest.raises(SimulatorError, match="grid simulator has no window"):
        make_simulator(SimulatorConfig(name="grid"), RANGE, gui=True)
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(SimulatorError, match="DISPLAY is not set"):
        make_simulator(SimulatorConfig(), RANGE, gui=True)
    monkeypatch.setenv("DISPLAY", ":987")
    with pytest.raises(SimulatorError, match=":987|libX11"):
        make_simulator(SimulatorConfig(), RANGE, gui=True)


def test_importing_pybullet_prints_nothing():
    pytest.importorskip("pybullet", reason="PyBullet is not installed")
    done = subprocess.run(
        [sys.executable, "-c", "import actors.simulators.bullet"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
