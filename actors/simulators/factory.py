"""Makes the simulator that a configuration asks for; PyBullet is imported only when it is."""

from __future__ import annotations

import inspect
import logging
from typing import Any, Final

from actors.simulators.base import Simulator
from actors.simulators.grid import GridSimulator
from common.config import SimulatorConfig
from common.errors import HDError, SimulatorError
from common.extensions import SIMULATORS
from common.system.extras import optional

_log = logging.getLogger(__name__)

_METHODS: Final = ("set_sensor_range", "reset", "scan", "drive_to", "close")


def make_simulator(config: SimulatorConfig, sensor_range: float, gui: bool = False) -> Simulator:
    """Make a simulator.

    Args:
        config: which simulator and fidelity, and its sensor.
        sensor_range: metres.
        gui: open its window; needs a display.

    Raises:
        ConfigError: there is no simulator of that name.
        MissingPackageError: PyBullet is not installed.
        SimulatorError: it cannot be made: no display is there for ``gui``, the simulator has
            no window, or what was made is no simulator.
    """
    factory = SIMULATORS.load(config.name)
    if gui and "gui" not in inspect.signature(factory).parameters:
        raise SimulatorError(f"the {config.name} simulator has no window: leave --gui out, or use --sim pybullet")
    window = {"gui": True} if gui else {}
    if config.name in SIMULATORS.shipped:
        made: Simulator = factory(config, sensor_range, **window)
        return made
    return _make_own(config.name, factory, config, sensor_range, window)


def simulator_label(config: SimulatorConfig) -> str:
    """Return how reports call a simulator: its name, with the fidelity where it has several."""
    return f"{config.name}-{config.fidelity}" if config.name == "pybullet" else config.name[:64]


def make_grid(config: SimulatorConfig, sensor_range: float) -> Simulator:
    """Make the simulator `grid`."""
    if config.fidelity == "dynamic" or config.lidar_layers != 1:
        _log.warning("simulator grid: fidelity and lidar_layers are PyBullet's and have no effect here")
    return GridSimulator(config, sensor_range)


def make_pybullet(config: SimulatorConfig, sensor_range: float, gui: bool = False) -> Simulator:
    """Make the simulator `pybullet` in the configured fidelity; MissingPackageError when PyBullet is not installed."""
    with optional("the pybullet simulator", "pybullet", instead="use --sim grid"):
        from actors.simulators.dynamic import DynamicSimulator
        from actors.simulators.kinematic import KinematicSimulator

    if config.fidelity == "dynamic":
        return DynamicSimulator(config, sensor_range, gui=gui)
    return KinematicSimulator(config, sensor_range, gui=gui)


def _make_own(
    name: str, factory: Any, config: SimulatorConfig, sensor_range: float, window: dict[str, bool]
) -> Simulator:
    """Make a simulator that does not ship, and say what is wrong with it."""
    try:
        made: Simulator = factory(config, sensor_range, **window)
    except HDError:
        raise
    except Exception as error:
        raise SimulatorError(
            f"cannot make simulator {name!r} ({type(error).__name__}: {error}): its class is called with a "
            "SimulatorConfig and the range of the sensor in metres"
        ) from error
    missing = [method for method in _METHODS if not hasattr(made, method)]
    if missing:
        raise SimulatorError(
            f"{name!r} is no simulator, it has no {', '.join(missing)}: see actors.simulators.base.Simulator"
        )
    return made
