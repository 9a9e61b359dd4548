"""A simulator of one's own: the lidar loses beams, as in rain. Anything with these five methods is a simulator.

Run it as ``python examples/own_simulator.py``. The commands take it by name, from this folder::

    hd-eval run --planner tour --sim own_simulator:RainySimulator --maps generator:office --limit 5 --out results/
    hd-learner start --sim own_simulator:RainySimulator --actors 2
    hd-actor --sim own_simulator:RainySimulator --connect tcp/192.168.1.5:7447
"""

from dataclasses import replace

import numpy as np

from hdplanner import GridMap, GridSimulator, Leg, Pose, Scan, SimulatorConfig, evaluate

LOST = 0.3
"""Share of the beams that come back from nowhere."""


class RainySimulator:
    """The simulator `grid` with rain."""

    def __init__(self, config: SimulatorConfig, sensor_range: float) -> None:
        self._inner = GridSimulator(config, sensor_range)
        self._rng = np.random.default_rng()

    def set_sensor_range(self, metres: float) -> None:
        """Let the sensor reach so far from the next scan on."""
        self._inner.set_sensor_range(metres)

    def reset(self, world: GridMap, seed: int) -> Pose:
        """Load a world and return where the robot stands."""
        self._rng = np.random.default_rng(seed)
        return self._inner.reset(world, seed)

    def scan(self) -> Scan:
        """Scan; a lost beam is NaN, and tells the belief nothing."""
        scan = self._inner.scan()
        lost = self._rng.random(len(scan.ranges)) < LOST
        return replace(scan, ranges=np.where(lost, np.float32(np.nan), scan.ranges))

    def drive_to(self, waypoint: tuple[float, float]) -> Leg:
        """Drive along the straight line to a waypoint."""
        return self._inner.drive_to(waypoint)

    def close(self) -> None:
        """Release the world."""
        self._inner.close()


if __name__ == "__main__":
    for name in ("grid", "own_simulator:RainySimulator"):
        (result,) = evaluate("tour", ["generator:rooms?width=480&height=320"], count=1, simulator=name)
        print(f"{name:30} {result.distance_m:.0f} m, {result.explored_rate:.1%} explored")
