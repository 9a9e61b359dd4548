"""Makes the simulator that a configuration asks for; PyBullet is imported only when it is."""

from __future__ import annotations

import logging

from actors.simulators.base import Simulator
from actors.simulators.grid import GridSimulator
from common.config.schema import SimulatorConfig
from common.errors import SimulatorError

_log = logging.getLogger(__name__)


def make_simulator(config: SimulatorConfig, sensor_range: float, gui: bool = False) -> Simulator:
    """Make a simulator.

    Args:
        config: which simulator and fidelity, and its sensor.
        sensor_range: metres.
        gui: open PyBullet's window; needs a display.

    Raises:
        SimulatorError: PyBullet is not installed, no display is there for ``gui``, or ``gui`` was asked of ``grid``.
    """
    if config.name == "grid":
        if gui:
            raise SimulatorError("the grid simulator has no window: leave --gui out, or use --sim pybullet")
        if config.fidelity == "dynamic" or config.lidar_layers != 1:
            _log.warning("simulator grid: fidelity and lidar_layers are PyBullet's and have no effect here")
        return GridSimulator(config, sensor_range)
    try:
        from actors.simulators.dynamic import DynamicSimulator
        from actors.simulators.kinematic import KinematicSimulator
    except ModuleNotFoundError as error:
        if error.name != "pybullet":
            raise
        raise SimulatorError(
            "the pybullet simulator needs PyBullet, which is not installed: pip install 'hdplanner[pybullet]' "
            "(ready-made wheels exist up to CPython 3.11, newer Pythons build it from source), or use --sim grid"
        ) from error
    if config.fidelity == "dynamic":
        return DynamicSimulator(config, sensor_range, gui=gui)
    return KinematicSimulator(config, sensor_range, gui=gui)
